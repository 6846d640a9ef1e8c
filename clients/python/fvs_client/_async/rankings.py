"""Rankings: get them, and the renders of their candidates."""

import time
from collections.abc import AsyncIterator, Callable
from typing import Unpack

import httpx2

from fvs_client import requests
from fvs_client._async.concurrency import sleep
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client.answers import mission_file, parse, refusal
from fvs_client.errors import ConnectionFailedError, FvsError
from fvs_client.models.display import Png
from fvs_client.models.missions import MissionFile, MissionSettings, mission_options
from fvs_client.models.rankings import RankingData
from fvs_client.request import REQUEST_ID, Request
from fvs_schema.base import Output
from fvs_schema.missions import MissionFormat
from fvs_schema.rankings import RankedCandidate, RankingSummary, ScoredCandidate


class AsyncRanking(AsyncResource, RankingData):
    """An immutable ranking; ``candidates`` are in order, the next view first."""

    async def render(self, candidate: RankedCandidate | str) -> Png:
        """Get the render of the ranking's snapshot at a candidate, as PNG; a notebook shows it."""
        return await self._image(candidate, "render")

    async def spectrum(self, candidate: RankedCandidate | str) -> Png:
        """Get the spectrum of a candidate's render, as PNG."""
        return await self._image(candidate, "spectrum")

    async def mission(self, format: MissionFormat | str, **settings: Unpack[MissionSettings]) -> MissionFile:  # noqa: A002
        """Get the ranked candidates, in their order, as a mission for an autopilot or a ground station.

        Raises ``InvalidRequestError`` when the scene is not georeferenced, or a view cannot be flown.
        """
        options = mission_options(format, settings)
        return mission_file(await self._session.response(requests.get_ranking_mission(self.id, options)))

    async def delete(self) -> None:
        """Delete the ranking with its renders."""
        await self._session.content(requests.delete_ranking(self.id))

    async def _image(self, candidate: RankedCandidate | str, kind: str) -> Png:
        candidate_id = candidate if isinstance(candidate, str) else candidate.id
        return Png(await self._session.content(requests.get_candidate_image(self.id, candidate_id, kind)))


class AsyncRankings:
    """Rankings by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, ranking_id: str) -> AsyncRanking:
        """Get a ranking."""
        return await self._session.fetch(AsyncRanking, requests.get_ranking(ranking_id))


class AsyncSceneRankings:
    """The rankings of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def list(self) -> AsyncIterator[RankingSummary]:
        """All rankings, newest first."""
        return self._session.items(RankingSummary, requests.rankings_of(self._scene_id))


class _AsyncPart(Output):
    """A part of a ranking that is streamed."""

    candidates: tuple[ScoredCandidate, ...]
    ranking: AsyncRanking | None


async def stream_ranking(
    session: AsyncSession, request: Request, on_scored: Callable[[tuple[ScoredCandidate, ...]], object]
) -> AsyncRanking:
    """Send ``request``, with retries, and return the ranking at the end of the stream.

    ``on_scored`` gets candidates as they are scored; again when the request is sent again.
    """
    request = request.identified()
    began, attempt = time.monotonic(), 0
    while True:
        attempt += 1
        try:
            return await _follow(session, request, on_scored)
        except FvsError as error:
            pause = session.retries.pause_s(error, attempt, time.monotonic() - began)
            if pause is None:
                raise
        await sleep(pause)


async def _follow(
    session: AsyncSession, request: Request, on_scored: Callable[[tuple[ScoredCandidate, ...]], object]
) -> AsyncRanking:
    request_id = request.headers[REQUEST_ID]
    async with session.open(request) as response:
        async for message in httpx2.EventSource(response, max_event_size=None):
            content = message.data.encode()
            if message.event == "problem":
                raise refusal(httpx2.Response(500, content=content), request_id)
            part = parse(_AsyncPart, content, session)
            if part.candidates:
                on_scored(part.candidates)
            if part.ranking is not None:
                return part.ranking
    raise ConnectionFailedError("The stream ended before the ranking.", request_id=request_id)
