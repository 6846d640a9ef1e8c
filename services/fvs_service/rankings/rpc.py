"""Rankings, plans, forecasts and missions over gRPC."""

from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import TypeVar

from anyio.to_thread import run_sync
from fvs.v1 import views_pb2 as pb
from google.protobuf.message import Message

from fvs_schema.base import Model, Page
from fvs_schema.forecasts import Forecast, ForecastRequest
from fvs_schema.missions import MissionFile, MissionOptions, MissionRequest, PlanMissionOptions
from fvs_schema.plans import Plan, PlanList, PlanRequest
from fvs_schema.rankings import Ranking, RankingList, RankingPart, RankingRequest
from fvs_schema.renders import RenderRequest, ViewImage
from fvs_schema.visits import VisitList, VisitReport
from fvs_service.application import Application
from fvs_service.gateway.rpc.calls import Call
from fvs_service.gateway.rpc.conversion import pick, read
from fvs_service.gateway.rpc.requests import idempotency_key
from fvs_service.principal import Principal, Scope

RequestT = TypeVar("RequestT", bound=Model)

_SMALL_BYTES = 16_384
"""Larger requests are read one at a time."""


class _Wanted(Model):
    image: ViewImage = ViewImage.RENDER


class ViewServicer:
    """``fvs.v1.ViewService``."""

    service = pb.DESCRIPTOR.services_by_name["ViewService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    async def rank_views(self, call: Call, caller: Principal, request: pb.RankViewsRequest) -> Ranking:
        """Rank candidates for the next image."""
        wanted = await self._unread(call, caller, request.scene_id, RankingRequest, request.ranking)
        metrics = call.gateway.metrics
        with metrics.rankings_open.track_inprogress():
            ranking = await self._app.rankings.create(
                caller, request.scene_id, wanted, call.timeout_s(), idempotency_key(request)
            )
        metrics.count_ranking(ranking.request.method, ranking.seconds, ranking.waited_s)
        return ranking

    async def stream_rank_views(
        self, call: Call, caller: Principal, request: pb.StreamRankViewsRequest
    ) -> AsyncIterator[RankingPart]:
        """Rank candidates, and return them as they are scored."""
        wanted = await self._unread(call, caller, request.scene_id, RankingRequest, request.ranking)
        metrics, key = call.gateway.metrics, idempotency_key(request)
        stream = self._app.rankings.stream(caller, request.scene_id, wanted, call.timeout_s(), key)
        with metrics.rankings_open.track_inprogress():
            async with aclosing(stream) as parts:
                async for part in parts:
                    if (made := part.ranking) is not None:
                        metrics.count_ranking(made.request.method, made.seconds, made.waited_s)
                    yield part

    def get_ranking(self, caller: Principal, request: pb.GetRankingRequest) -> Ranking:
        """Return a ranking."""
        return self._app.rankings.get(caller, request.ranking_id)

    def list_rankings(self, caller: Principal, request: pb.ListRankingsRequest) -> RankingList:
        """List the rankings of a scene."""
        page = pick(Page, request)
        return self._app.rankings.of_scene(caller, request.scene_id, page)

    def delete_ranking(self, caller: Principal, request: pb.DeleteRankingRequest) -> None:
        """Delete a ranking."""
        self._app.deletions.ranking(caller, request.ranking_id)

    async def render_candidate(
        self, call: Call, caller: Principal, request: pb.RenderCandidateRequest
    ) -> pb.CandidateRender:
        """Render a candidate's view, or the spectrum of it."""
        image = pick(_Wanted, request).image
        with call.gateway.metrics.rankings_open.track_inprogress():
            png = await self._app.renders.of_candidate(
                caller, request.ranking_id, request.candidate_id, image, call.timeout_s()
            )
        return pb.CandidateRender(png=png)

    async def render_view(
        self, call: Call, caller: Principal, request: pb.RenderViewRequest
    ) -> pb.ViewRender:
        """Render a snapshot at any pose, or the spectrum of that render."""
        with call.gateway.metrics.rankings_open.track_inprogress():
            content, media_type = await self._app.renders.at_pose(
                caller, request.snapshot_id, lambda: read(RenderRequest, request.render), call.timeout_s()
            )
        return pb.ViewRender(content=content, media_type=media_type)

    async def plan_views(self, call: Call, caller: Principal, request: pb.PlanViewsRequest) -> Plan:
        """Plan which candidates to photograph next."""
        wanted = await self._unread(call, caller, request.scene_id, PlanRequest, request.plan)
        with call.gateway.metrics.rankings_open.track_inprogress():
            return await self._app.plans.create(
                caller, request.scene_id, wanted, call.timeout_s(), idempotency_key(request)
            )

    async def forecast_views(
        self, call: Call, caller: Principal, request: pb.ForecastViewsRequest
    ) -> Forecast:
        """Forecast the kriging variance of poses, or of places of the surface."""
        wanted = await self._unread(
            call, caller, request.scene_id, ForecastRequest, request.forecast, Scope.READ
        )
        with call.gateway.metrics.rankings_open.track_inprogress():
            return await self._app.forecasts.create(caller, request.scene_id, wanted, call.timeout_s())

    def list_plans(self, caller: Principal, request: pb.ListPlansRequest) -> PlanList:
        """List the plans of a scene."""
        page = pick(Page, request)
        return self._app.plans.of_scene(caller, request.scene_id, page)

    def get_plan(self, caller: Principal, request: pb.GetPlanRequest) -> Plan:
        """Return a plan."""
        return self._app.plans.get(caller, request.plan_id)

    def delete_plan(self, caller: Principal, request: pb.DeletePlanRequest) -> None:
        """Delete a plan."""
        self._app.deletions.plan(caller, request.plan_id)

    def report_visits(self, caller: Principal, request: pb.ReportVisitsRequest) -> VisitList:
        """Report what a vehicle does about views."""
        report = read(VisitReport, request.report, self._app.storage.settings.limits)
        return self._app.visits.report(caller, request.scene_id, report)

    def list_visits(self, caller: Principal, request: pb.ListVisitsRequest) -> VisitList:
        """List what vehicles do about views."""
        return self._app.visits.of_scene(caller, request.scene_id)

    def get_ranking_mission(self, caller: Principal, request: pb.GetRankingMissionRequest) -> pb.MissionFile:
        """Write the ranked candidates of a ranking as a mission."""
        options = pick(MissionOptions, request)
        return _mission(self._app.missions.of_ranking(caller, request.ranking_id, options))

    def get_plan_mission(self, caller: Principal, request: pb.GetPlanMissionRequest) -> pb.MissionFile:
        """Write the stops of one vehicle of a plan as a mission."""
        options = pick(PlanMissionOptions, request)
        return _mission(self._app.missions.of_plan(caller, request.plan_id, options))

    async def create_mission(
        self, call: Call, caller: Principal, request: pb.CreateMissionRequest
    ) -> pb.MissionFile:
        """Write views as a mission."""
        options = pick(MissionOptions, request)
        wanted = await self._unread(
            call, caller, request.scene_id, MissionRequest, request.mission, Scope.READ
        )
        return _mission(
            await run_sync(self._app.missions.of_views, caller, request.scene_id, wanted, options)
        )

    async def _unread(
        self,
        call: Call,
        caller: Principal,
        scene_id: str,
        kind: type[RequestT],
        request: Message,
        scope: Scope = Scope.OPERATE,
    ) -> Callable[[], RequestT]:
        """The request, to be read in a thread that has checked the permission; a large one has been read."""
        limits = self._app.storage.settings.limits

        def parsed() -> RequestT:
            return read(kind, request, limits)

        def checked() -> RequestT:
            self._app.scenes.require(caller, scope, scene_id)
            return parsed()

        if (size_bytes := request.ByteSize()) <= _SMALL_BYTES:
            return parsed
        found = await call.run(size_bytes, checked)
        call.end_turn()
        return lambda: found


def _mission(file: MissionFile) -> pb.MissionFile:
    return pb.MissionFile(
        name=file.name,
        media_type=file.media_type,
        content=file.content,
        left_out=file.left_out,
        reasons=file.reasons,
        parts=file.parts,
        views=file.views,
        length_m=file.length_m,
        duration_s=file.duration_s,
    )
