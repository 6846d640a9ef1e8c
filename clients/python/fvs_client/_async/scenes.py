"""Scenes: create, get, list, change and delete them; update and rank one."""

from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from typing import Self, Unpack

from fvs_client import requests
from fvs_client._async.events import follow
from fvs_client._async.images import AsyncSceneImages
from fvs_client._async.jobs import AsyncJob, AsyncSceneJobs
from fvs_client._async.plans import AsyncPlan, AsyncScenePlans
from fvs_client._async.rankings import AsyncRanking, AsyncSceneRankings, stream_ranking
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client._async.snapshots import AsyncSceneSnapshots
from fvs_client._async.webhooks import AsyncSceneWebhooks
from fvs_client.answers import mission_file
from fvs_client.models.missions import MissionFile, MissionSettings, mission_options
from fvs_client.models.resources import SceneData
from fvs_client.models.views import candidates_of, mission_of
from fvs_schema.candidates import Candidate, Generator, PlanGenerator
from fvs_schema.control_points import ControlPoints
from fvs_schema.events import Event
from fvs_schema.forecasts import Forecast, ForecastRequest, Surface
from fvs_schema.images import Image
from fvs_schema.jobs import JobKind
from fvs_schema.missions import MissionFormat, MissionRequest
from fvs_schema.plans import PlanRequest, Stop, Tour
from fvs_schema.poses import Pose, PoseFrame
from fvs_schema.rankings import RankedCandidate, RankingRequest, ScoredCandidate
from fvs_schema.scenes import (
    AutomaticWorld,
    CameraPrior,
    Policy,
    Retention,
    SceneChange,
    SceneRequest,
    SceneSize,
    World,
)
from fvs_schema.terrain import AnyTerrain
from fvs_schema.visits import Visit, VisitList, VisitReport, VisitState
from fvs_schema.volumes import Volume
from fvs_schema.words import Method as RankingMethod


class AsyncScene(AsyncResource, SceneData):
    """A scene as it was when it was fetched; ``refresh`` returns its current state."""

    @property
    def images(self) -> AsyncSceneImages:
        """The scene's images (``image_counts`` has their numbers)."""
        return AsyncSceneImages(self._session, self.id)

    @property
    def jobs(self) -> AsyncSceneJobs:
        """The scene's jobs."""
        return AsyncSceneJobs(self._session, self.id)

    @property
    def rankings(self) -> AsyncSceneRankings:
        """The scene's rankings."""
        return AsyncSceneRankings(self._session, self.id)

    @property
    def plans(self) -> AsyncScenePlans:
        """The scene's plans."""
        return AsyncScenePlans(self._session, self.id)

    @property
    def snapshots(self) -> AsyncSceneSnapshots:
        """The scene's snapshots."""
        return AsyncSceneSnapshots(self._session, self.id)

    @property
    def webhooks(self) -> AsyncSceneWebhooks:
        """The scene's webhooks."""
        return AsyncSceneWebhooks(self._session, self.id)

    async def refresh(self) -> Self:
        """Get the scene's current state."""
        return await self._session.fetch(type(self), requests.get_scene(self.id))

    async def change(
        self,
        *,
        name: str | None = None,
        policy: Policy | None = None,
        retention: Retention | None = None,
        if_unchanged: bool = False,
    ) -> Self:
        """Rename the scene, or change its policy or retention; None leaves a setting as it is.

        With ``if_unchanged`` raises ``PreconditionFailedError`` when the scene is not as it was when it was
        fetched: it has other settings, images or snapshots.
        """
        change = SceneChange(name=name, policy=policy, retention=retention)
        request = requests.change_scene(self.id, change, self.etag if if_unchanged else None)
        return await self._session.fetch(type(self), request)

    async def delete(self, *, if_unchanged: bool = False) -> None:
        """Permanently delete the scene and everything in it; its running jobs stop.

        ``if_unchanged`` as in ``change``.
        """
        request = requests.delete_scene(self.id, self.etag if if_unchanged else None)
        await self._session.content(request)

    async def set_control_points(self, points: ControlPoints) -> ControlPoints:
        """Set the control points: the next update or fine job is aligned by them, its snapshot has residuals.

        Raises ``InvalidRequestError`` for a CRS, coordinates or heights that cannot be used.
        """
        return await self._session.fetch(ControlPoints, requests.set_control_points(self.id, points))

    async def control_points(self) -> ControlPoints:
        """Get the control points; raises ``NotFoundError`` when there are none."""
        return await self._session.fetch(ControlPoints, requests.get_control_points(self.id))

    async def delete_control_points(self) -> None:
        """Delete the control points: the next model is aligned by position priors."""
        await self._session.content(requests.delete_control_points(self.id))

    async def size(self) -> SceneSize:
        """Get the disk space of the scene."""
        return await self._session.fetch(SceneSize, requests.get_scene_size(self.id))

    async def update(self, *, iterations: int | None = None, long_side_px: int | None = None) -> AsyncJob:
        """Queue an update: register all pending images and train the model anew."""
        return await self.jobs.create(JobKind.UPDATE, iterations=iterations, long_side_px=long_side_px)

    async def fine(
        self,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
    ) -> AsyncJob:
        """Queue a fine job: train the final model; with ``test_every``, every Nth image is held out."""
        return await self.jobs.create(
            JobKind.FINE, iterations=iterations, long_side_px=long_side_px, test_every=test_every
        )

    async def rank(
        self,
        candidates: Mapping[str, Pose] | Iterable[Candidate] | None = None,
        *,
        generator: Generator | None = None,
        current_pose: Pose | None = None,
        radius_m: float | None = None,
        safety_m: float | None = None,
        no_fly: Iterable[Volume] | None = None,
        terrain: AnyTerrain | None = None,
        rank_all: bool = False,
        frame: PoseFrame | None = None,
        top_k: int | None = None,
        method: RankingMethod | str = "median-frequency",
        snapshot_id: str | None = None,
        budget: int = 1,
        seed: int = 0,
        for_vehicle: str | None = None,
        timeout_s: float | None = None,
        idempotency_key: str | None = None,
        on_scored: Callable[[tuple[ScoredCandidate, ...]], object] | None = None,
    ) -> AsyncRanking:
        """Rank the views that could be photographed next; answered at once, also while a job runs.

        ``candidates`` are poses by candidate id, or made by a ``generator``, by default an orbit. ``frame``
        is that of the ranking's poses, by default that of the candidates. With ``radius_m``, only candidates
        within that distance of ``current_pose`` are ranked. Those nearer than ``safety_m`` to matter (by
        default half the distance from which the nearest photographs saw it), in one of the volumes ``no_fly``
        or unlikely to be registered have no rank, but with ``rank_all``; those under the ``terrain``, whose
        heights have the datum of the scene's altitudes, never. ``for_vehicle`` is the name of the
        requesting vehicle in its visits. ``on_scored`` gets candidates as they are scored; raise in it to end
        the ranking. Raises ``NoSnapshotError`` when the scene has no model, ``DeadlineExceededError``
        when the ranking takes longer than ``timeout_s``.
        """
        ranking = RankingRequest(
            candidates=candidates_of(candidates),
            generator=generator,
            current_pose=current_pose,
            radius_m=radius_m,
            safety_m=safety_m,
            no_fly=() if no_fly is None else tuple(no_fly),
            terrain=terrain,
            rank_all=rank_all,
            frame=frame,
            top_k=top_k,
            method=method,
            snapshot_id=snapshot_id,
            budget=budget,
            seed=seed,
            for_vehicle=for_vehicle,
        )
        if on_scored is not None:
            streamed = requests.create_ranking(self.id, ranking, idempotency_key, timeout_s, streamed=True)
            return await stream_ranking(self._session, streamed, on_scored)
        request = requests.create_ranking(self.id, ranking, idempotency_key, timeout_s)
        return await self._session.fetch(AsyncRanking, request)

    async def plan(
        self,
        candidates: Mapping[str, Pose] | Iterable[Candidate] | None = None,
        *,
        generator: Generator | None = None,
        targets: Mapping[str, Pose] | Iterable[Candidate] | None = None,
        views: int = 10,
        distance_m: float | None = None,
        home: bool = False,
        safety_m: float | None = None,
        no_fly: Iterable[Volume] | None = None,
        terrain: AnyTerrain | None = None,
        vehicles: Iterable[Pose] | None = None,
        for_vehicle: str | None = None,
        frame: PoseFrame | None = None,
        snapshot_id: str | None = None,
        timeout_s: float | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncPlan:
        """Plan which views to photograph next, in which order; answered at once, also while a job runs.

        Of the ``candidates``, given as for ``rank``, at most ``views``, within ``distance_m`` for each of
        the ``vehicles``, by default one at the last image; with ``home`` they fly back. ``targets`` are poses
        that the model must serve, by default its images and the candidates. Vehicles keep ``safety_m`` from
        the model's matter, and out of the volumes ``no_fly``; a stop says what its way goes ``via``.
        Candidates under the ``terrain``, given as for ``rank``, are not planned, and a warning names them.
        Raises ``NoSnapshotError`` when the scene has no model, ``InvalidRequestError`` for what cannot be
        flown.
        """
        plan = PlanRequest(
            candidates=candidates_of(candidates),
            generator=generator,
            targets=candidates_of(targets),
            views=views,
            distance_m=distance_m,
            home=home,
            safety_m=safety_m,
            no_fly=() if no_fly is None else tuple(no_fly),
            terrain=terrain,
            vehicles=None if vehicles is None else tuple(vehicles),
            for_vehicle=for_vehicle,
            frame=frame,
            snapshot_id=snapshot_id,
        )
        request = requests.create_plan(self.id, plan, idempotency_key, timeout_s)
        return await self._session.fetch(AsyncPlan, request)

    async def forecast(
        self,
        candidates: Mapping[str, Pose] | Iterable[Candidate] | None = None,
        *,
        generator: PlanGenerator | None = None,
        surface: Surface | None = None,
        after: Mapping[str, Pose] | Iterable[Candidate] | None = None,
        frame: PoseFrame | None = None,
        snapshot_id: str | None = None,
        timeout_s: float | None = None,
    ) -> Forecast:
        """Forecast the variance of ``candidates``, given as for ``rank``, or of places of the ``surface``.

        ``after`` are views that count as photographed, such as the stops of a plan by id. Nothing is stored.
        Raises ``NoSnapshotError`` when the scene has no model.
        """
        forecast = ForecastRequest(
            candidates=candidates_of(candidates),
            generator=generator,
            surface=surface,
            after=candidates_of(after) or (),
            frame=frame,
            snapshot_id=snapshot_id,
        )
        return await self._session.fetch(Forecast, requests.create_forecast(self.id, forecast, timeout_s))

    async def report_visits(
        self,
        vehicle: str,
        state: VisitState,
        views: Mapping[str, Pose] | Iterable[Candidate],
        *,
        expires_in_s: int = 600,
    ) -> tuple[Visit, ...]:
        """Report what a vehicle does about views, candidates of a ranking or stops of a plan.

        Views that it flies to are taken for all others, in rankings and plans, for ``expires_in_s``. Returns
        all current visits of the scene. Raises ``ConflictError`` when one of the views is taken already:
        none is reported then.
        """
        listed = candidates_of(views) or ()
        report = VisitReport(vehicle=vehicle, state=state, views=listed, expires_in_s=expires_in_s)
        return (await self._session.fetch(VisitList, requests.report_visits(self.id, report))).visits

    async def visits(self) -> tuple[Visit, ...]:
        """What vehicles do about views, until their reports expire."""
        return (await self._session.fetch(VisitList, requests.list_visits(self.id))).visits

    async def mission(
        self,
        views: Tour | Mapping[str, Pose] | Iterable[Candidate | RankedCandidate | Stop],
        format: MissionFormat | str,  # noqa: A002
        *,
        snapshot_id: str | None = None,
        terrain: AnyTerrain | None = None,
        **settings: Unpack[MissionSettings],
    ) -> MissionFile:
        """Get views, such as stops of plans or candidates of rankings, as a mission.

        ``snapshot_id`` is the one whose alignment relates poses of the model frame to the world, by default
        the newest. ``terrain`` is the ground from which heights are measured, such as one of a
        ``HeightModel``; then home must be given. Raises ``InvalidRequestError`` when the scene is not
        georeferenced, or a view cannot be flown.
        """
        options = mission_options(format, settings)
        mission = mission_of(views, snapshot_id, terrain)
        return mission_file(await self._session.response(requests.create_mission(self.id, mission, options)))

    async def mission_of_images(
        self,
        format: MissionFormat | str,  # noqa: A002
        images: Iterable[Image | str] | None = None,
        *,
        snapshot_id: str | None = None,
        terrain: AnyTerrain | None = None,
        **settings: Unpack[MissionSettings],
    ) -> MissionFile:
        """Get the photographs of a snapshot, by default of the newest, as a mission that takes them again.

        ``images`` are registered ones, or their digests; by default all, in the order in which they were
        taken. Raises as ``mission``.
        """
        options = mission_options(format, settings)
        digests = None
        if images is not None:
            digests = tuple(image if isinstance(image, str) else image.digest for image in images)
        mission = MissionRequest(
            images=digests, all_images=digests is None, snapshot_id=snapshot_id, terrain=terrain
        )
        return mission_file(await self._session.response(requests.create_mission(self.id, mission, options)))

    def events(self, after: int | None = 0) -> AsyncIterator[Event]:
        """The scene's events after number ``after`` (None: only new ones), until the scene is deleted.

        Resumes after a broken connection; no event is lost or repeated.
        """
        return follow(self._session, self.id, after)


class AsyncScenes:
    """All scenes."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def create(
        self,
        name: str,
        *,
        world: World | None = None,
        camera: CameraPrior | None = None,
        policy: Policy | None = None,
        retention: Retention | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncScene:
        """Create a scene; by default its world comes from the GPS positions of its images."""
        scene = SceneRequest(
            name=name,
            world=world or AutomaticWorld(),
            camera=camera,
            policy=policy or Policy(),
            retention=retention or Retention(),
        )
        return await self._session.fetch(AsyncScene, requests.create_scene(scene, idempotency_key))

    async def get(self, scene_id: str) -> AsyncScene:
        """Get a scene."""
        return await self._session.fetch(AsyncScene, requests.get_scene(scene_id))

    def images(self, scene_id: str) -> AsyncSceneImages:
        """The images of a scene, without fetching the scene: for a device whose API key may only upload."""
        return AsyncSceneImages(self._session, scene_id)

    def list(self, *, name: str | None = None, search: str | None = None) -> AsyncIterator[AsyncScene]:
        """All scenes, or those with this ``name``, or whose name contains ``search``, newest first."""
        given = {"name": name, "search": search}
        query = {key: value for key, value in given.items() if value is not None}
        return self._session.items(AsyncScene, "/v1/scenes", query)
