"""Rankings: get them, and the renders of their candidates."""

from fvs_client import requests
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client.models.rankings import RankedCandidate, RankingData


class AsyncRanking(AsyncResource, RankingData):
    """An immutable ranking; ``candidates`` are in order, the next view first."""

    async def render(self, candidate: RankedCandidate | str) -> bytes:
        """Get the render of the ranking's snapshot at a candidate, as PNG."""
        return await self._image(candidate, "render")

    async def spectrum(self, candidate: RankedCandidate | str) -> bytes:
        """Get the spectrum of a candidate's render, as PNG."""
        return await self._image(candidate, "spectrum")

    async def delete(self) -> None:
        """Delete the ranking with its renders."""
        await self._session.content(requests.delete_ranking(self.id))

    async def _image(self, candidate: RankedCandidate | str, kind: str) -> bytes:
        candidate_id = candidate if isinstance(candidate, str) else candidate.id
        return await self._session.content(requests.get_candidate_image(self.id, candidate_id, kind))


class AsyncRankings:
    """Rankings by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, ranking_id: str) -> AsyncRanking:
        """Get a ranking."""
        return await self._session.fetch(AsyncRanking, requests.get_ranking(ranking_id))
