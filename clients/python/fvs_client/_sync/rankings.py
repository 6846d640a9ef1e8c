# Generated from _async/rankings.py by `make generate`. Do not edit.
"""Rankings: get them, and the renders of their candidates."""

from fvs_client import requests
from fvs_client._sync.session import Resource, Session
from fvs_client.models.rankings import RankedCandidate, RankingData


class Ranking(Resource, RankingData):
    """An immutable ranking; ``candidates`` are in order, the next view first."""

    def render(self, candidate: RankedCandidate | str) -> bytes:
        """Get the render of the ranking's snapshot at a candidate, as PNG."""
        return self._image(candidate, "render")

    def spectrum(self, candidate: RankedCandidate | str) -> bytes:
        """Get the spectrum of a candidate's render, as PNG."""
        return self._image(candidate, "spectrum")

    def delete(self) -> None:
        """Delete the ranking with its renders."""
        self._session.content(requests.delete_ranking(self.id))

    def _image(self, candidate: RankedCandidate | str, kind: str) -> bytes:
        candidate_id = candidate if isinstance(candidate, str) else candidate.id
        return self._session.content(requests.get_candidate_image(self.id, candidate_id, kind))


class Rankings:
    """Rankings by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, ranking_id: str) -> Ranking:
        """Get a ranking."""
        return self._session.fetch(Ranking, requests.get_ranking(ranking_id))
