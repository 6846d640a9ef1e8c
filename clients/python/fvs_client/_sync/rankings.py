# Generated from _async/rankings.py by `make generate`. Do not edit.
"""Rankings: get them, and the renders of their candidates."""

import time
from collections.abc import Callable, Iterator
from typing import Unpack

import httpx2

from fvs_client import requests
from fvs_client._sync.concurrency import sleep
from fvs_client._sync.session import Resource, Session
from fvs_client.answers import mission_file, parse, refusal
from fvs_client.errors import ConnectionFailedError, FvsError
from fvs_client.models.display import Png
from fvs_client.models.missions import MissionFile, MissionSettings, mission_options
from fvs_client.models.rankings import RankingData
from fvs_client.request import REQUEST_ID, Request
from fvs_schema.base import Output
from fvs_schema.missions import MissionFormat
from fvs_schema.rankings import RankedCandidate, RankingSummary, ScoredCandidate


class Ranking(Resource, RankingData):
    """An immutable ranking; ``candidates`` are in order, the next view first."""

    def render(self, candidate: RankedCandidate | str) -> Png:
        """Get the render of the ranking's snapshot at a candidate, as PNG; a notebook shows it."""
        return self._image(candidate, "render")

    def spectrum(self, candidate: RankedCandidate | str) -> Png:
        """Get the spectrum of a candidate's render, as PNG."""
        return self._image(candidate, "spectrum")

    def mission(self, format: MissionFormat | str, **settings: Unpack[MissionSettings]) -> MissionFile:  # noqa: A002
        """Get the ranked candidates, in their order, as a mission for an autopilot or a ground station.

        Raises ``InvalidRequestError`` when the scene is not georeferenced, or a view cannot be flown.
        """
        options = mission_options(format, settings)
        return mission_file(self._session.response(requests.get_ranking_mission(self.id, options)))

    def delete(self) -> None:
        """Delete the ranking with its renders."""
        self._session.content(requests.delete_ranking(self.id))

    def _image(self, candidate: RankedCandidate | str, kind: str) -> Png:
        candidate_id = candidate if isinstance(candidate, str) else candidate.id
        return Png(self._session.content(requests.get_candidate_image(self.id, candidate_id, kind)))


class Rankings:
    """Rankings by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, ranking_id: str) -> Ranking:
        """Get a ranking."""
        return self._session.fetch(Ranking, requests.get_ranking(ranking_id))


class SceneRankings:
    """The rankings of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def list(self) -> Iterator[RankingSummary]:
        """All rankings, newest first."""
        return self._session.items(RankingSummary, requests.rankings_of(self._scene_id))


class _Part(Output):
    """A part of a ranking that is streamed."""

    candidates: tuple[ScoredCandidate, ...]
    ranking: Ranking | None


def stream_ranking(
    session: Session, request: Request, on_scored: Callable[[tuple[ScoredCandidate, ...]], object]
) -> Ranking:
    """Send ``request``, with retries, and return the ranking at the end of the stream.

    ``on_scored`` gets candidates as they are scored; again when the request is sent again.
    """
    request = request.identified()
    began, attempt = time.monotonic(), 0
    while True:
        attempt += 1
        try:
            return _follow(session, request, on_scored)
        except FvsError as error:
            pause = session.retries.pause_s(error, attempt, time.monotonic() - began)
            if pause is None:
                raise
        sleep(pause)


def _follow(
    session: Session, request: Request, on_scored: Callable[[tuple[ScoredCandidate, ...]], object]
) -> Ranking:
    request_id = request.headers[REQUEST_ID]
    with session.open(request) as response:
        for message in httpx2.EventSource(response, max_event_size=None):
            content = message.data.encode()
            if message.event == "problem":
                raise refusal(httpx2.Response(500, content=content), request_id)
            part = parse(_Part, content, session)
            if part.candidates:
                on_scored(part.candidates)
            if part.ranking is not None:
                return part.ranking
    raise ConnectionFailedError("The stream ended before the ranking.", request_id=request_id)
