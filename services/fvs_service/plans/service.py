"""Plans of flights. They never wait for a job: the scene's runner makes them while it trains."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from anyio.to_thread import run_sync

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.ground import GroundCheck
from fvs_engine.plan import plan_records as engine_records
from fvs_engine.plan.plan_warnings import ground_findings
from fvs_schema.base import Page
from fvs_schema.candidates import InVolume, wanted_of
from fvs_schema.events import EventKind
from fvs_schema.plans import CandidateTerms, Expectation, Plan, PlanList, PlanRequest, Stop, Tour
from fvs_schema.service import Limits
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.errors import InvalidRequestError
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.plans import repository
from fvs_service.plans.in_world import via
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.in_model import require_volumes
from fvs_service.rankings.port import PlanViews, SceneRunners
from fvs_service.rankings.pose_frames import poses_in
from fvs_service.rankings.preparation import Begun, TakenPoses
from fvs_service.rankings.snapshot_frames import SnapshotFrames, by_id
from fvs_service.rankings.under_ground import kept
from fvs_service.rankings.warnings import warnings_of
from fvs_service.scenes.lease import find_endpoint
from fvs_service.scenes.poses import require_on_earth
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database, Reader
from fvs_service.storage.idempotency import IdempotencyKey

_MOST_TERMS = 200

ReadRequest: TypeAlias = Callable[[], PlanRequest]
"""Reads a request; it is called in a thread, after the permission check."""


@dataclass(frozen=True)
class _Prepared:
    """The validated input of a plan, which the runner then computes.

    ``poses`` of all candidates; those that were ``photographed`` or are under the ``ground`` are not planned.
    """

    begun: Begun[PlanRequest]
    poses: Mapping[str, RigidTransform]
    photographed: frozenset[str]
    ground: GroundCheck
    model_request: PlanViews


class Plans:
    """Plans flights through candidates.

    Plans are kept: ``require_room`` raises ``OutOfSpaceError`` when there is no room for another one.
    """

    def __init__(
        self,
        database: Database,
        frames: SnapshotFrames,
        runners: SceneRunners,
        limits: Limits,
        taken_poses: TakenPoses,
        require_room: Callable[[], object] = lambda: None,
    ) -> None:
        self._taken_poses = taken_poses
        self._require_room = require_room
        self._database = database
        self._frames = frames
        self._runners = runners
        self._limit = ConcurrencyLimit("rankings", limits.rankings_at_once_per_tenant)

    async def create(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None = None,
    ) -> Plan:
        """Plan with the newest model of a scene, or with one of its snapshots.

        Cancelling it gives up waiting. Raises ``InvalidRequestError`` for what cannot be flown, and
        ``DeadlineError`` when it takes longer than ``timeout_s``.
        """
        with self._limit.slot(principal.tenant_id):
            begun = await run_sync(self._begin, principal, scene_id, read, timeout_s, key)
            if isinstance(begun, Plan):
                return begun
            poses, spent_s = None, 0.0
            if isinstance(begun.request.generator, InVolume):
                poses, spent_s = await begun.generated(self._runners)
            prepared = await run_sync(self._prepare, begun, poses, spent_s)
            planned = await self._runners.plan(prepared.model_request)
            return await run_sync(self._finish, prepared, planned)

    def get(self, principal: Principal, plan_id: str) -> Plan:
        """One plan; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.querying() as reader:
            return repository.plan_of(reader, principal, plan_id)

    def of_scene(self, principal: Principal, scene_id: str, page: Page) -> PlanList:
        """The plans of a scene, the newest first; refuses a cursor of another list."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_head_of(session, principal, scene_id)
            return repository.plans_of_scene(session, scene_id, page)

    def _begin(
        self, principal: Principal, scene_id: str, read: ReadRequest, timeout_s: float, key: str | None
    ) -> Begun[PlanRequest] | Plan:
        """The plan before its candidates are known, or the one that the same idempotency key made."""
        principal.require(Scope.OPERATE, scene_id)
        with self._database.querying() as reader:
            scene = scene_head_of(reader, principal, scene_id)
            request = read()
            require_volumes(request.generator, request.no_fly)
            remembered = IdempotencyKey(principal.tenant_id, key, f"plans.create {scene_id}", request)
            earlier = _earlier(reader, principal, remembered)
            if earlier is not None:
                return earlier
            endpoint = find_endpoint(reader, scene_id)
            taken_poses = self._taken_poses(reader, scene_id, request.for_vehicle)
        self._require_room()
        return Begun.of(
            self._frames,
            principal,
            request,
            scene,
            endpoint,
            taken_poses,
            request.terrain,
            timeout_s,
            remembered,
        )

    def _prepare(
        self, begun: Begun[PlanRequest], found: Mapping[str, RigidTransform] | None, spent_s: float
    ) -> _Prepared:
        """The request to the runner; ``found`` are candidates in a volume, which took ``spent_s``."""
        request, frame, geometry = begun.request, begun.frame, begun.geometry
        generator = request.generator
        photographed: frozenset[str] = frozenset()
        if found is not None:
            poses = found
        else:
            assert not isinstance(generator, InVolume)
            poses = self._frames.candidates(request.candidates, generator, frame, geometry)
            taken = tuple(begun.taken.values())
            photographed = geometry.visited(poses) | geometry.same_view(poses, taken)
        ground, left = begun.above_ground(poses, photographed)
        if not left:
            under = f", or are under the ground ({len(ground.under)})" if ground.under else ""
            raise InvalidRequestError(
                f"All {len(poses)} candidates were photographed already, or are taken by a visit{under}.",
                hint="Give other candidates.",
            )
        served = by_id(request.targets or (), frame)
        vehicles = frame.world_from_cameras(request.vehicles or ())
        starts = {f"vehicle {number}": pose for number, pose in enumerate(vehicles)}
        require_on_earth({**served, **starts})
        scale = frame.world_from_model.scale
        model_request = PlanViews(
            scene_id=begun.scene.id,
            endpoint=begun.endpoint,
            snapshot_id=begun.snapshot.id,
            api_key=begun.principal.key_id,
            timeout_s=max(0.0, begun.timeout_s - spent_s),
            views=frame.views(left, begun.camera),
            clearance=begun.clearance if request.around else None,
            targets=frame.views(served, begun.camera),
            taken=frame.views(begun.taken, begun.camera),
            starts=tuple(tuple(view.centre.tolist()) for view in frame.views(starts, begun.camera)),
            budget=request.views,
            distance=None if request.distance_m is None else request.distance_m / scale,
            home=request.home,
            scale=scale,
            updates=self._frames.updates(begun.scene.id),
        )
        return _Prepared(begun, poses, photographed, ground, model_request)

    def _finish(self, prepared: _Prepared, planned: engine_records.Plan) -> Plan:
        """Keep the plan of a runner."""
        plan = _plan(prepared, planned)
        principal, remembered = prepared.begun.principal, prepared.begun.remembered
        # A plan that a power cut undoes can be requested again, as a ranking.
        with self._database.writing(principal.tenant_id, plan.scene_id, durable=False) as session:
            scene_head_of(session, principal, plan.scene_id)  # it may have been deleted meanwhile
            earlier = _earlier(session, principal, remembered)
            if earlier is not None:  # the same request, sent twice at once
                return earlier
            repository.add_plan(session, plan)
            remembered.remember(session, plan.id)
            data = {"plan_id": plan.id, "snapshot_id": plan.snapshot_id}
            publish(session, plan.scene_id, EventKind.PLAN_CREATED, data)
        return plan


def _earlier(reader: Reader, principal: Principal, key: IdempotencyKey) -> Plan | None:
    """The plan that an earlier request with the same idempotency key made."""
    return key.resource(reader, lambda made: repository.plan_of(reader, principal, made))


def _plan(prepared: _Prepared, plan: engine_records.Plan) -> Plan:
    """The engine's plan, with poses and lengths of the world frame."""
    begun, poses = prepared.begun, prepared.poses
    request, frame, snapshot = begun.request, begun.frame, begun.snapshot
    scale = frame.world_from_model.scale
    names = [stop.name for tour in plan.tours for stop in tour.stops]
    current = request.vehicles[0] if request.vehicles else None
    shown = poses_in(frame, names, poses, request.candidates or (), request.frame, current)
    pose_of = dict(zip(names, shown, strict=True))
    tours = tuple(
        Tour(
            vehicle=number,
            stops=tuple(
                Stop(
                    id=stop.name,
                    pose=pose_of[stop.name],
                    distance_m=stop.distance * scale,
                    travel_m=stop.travel * scale,
                    after=_expectation(stop.after),
                    via=via(stop.via, poses[stop.name], pose_of[stop.name], frame),
                )
                for stop in tour.stops
            ),
            length_m=tour.length * scale,
            via_home=via(tour.via_home, poses[last], pose_of[last], frame)
            if tour.stops and (last := tour.stops[-1].name)
            else (),
        )
        for number, tour in enumerate(plan.tours, 1)
    )
    return Plan(
        id=new_id("pln"),
        scene_id=begun.scene.id,
        snapshot_id=snapshot.id,
        request=request.model_copy(update={"terrain": kept(request.terrain)}),
        summary=plan.sentence("m" if frame.aligned else "units", scale),
        now=_expectation(plan.now),
        end=_expectation(plan.end),
        tours=tours,
        candidates=_terms(plan, scale),
        photographed=tuple(sorted(prepared.photographed)),
        alignment=snapshot.alignment,
        origin=begun.scene.origin if frame.georeferenced else None,
        warnings=warnings_of(
            snapshot.alignment,
            in_model=request.in_model,
            candidates=len(prepared.model_request.views),
            registrable=plan.registrable,
            wanted=wanted_of(request.generator),
            made=len(poses),
            more=(*ground_findings(prepared.ground), *plan.warnings),
        ),
        created_at=now(),
    )


def _terms(plan: engine_records.Plan, scale: float) -> tuple[CandidateTerms, ...]:
    return tuple(
        CandidateTerms(
            id=term.name,
            planned=term.planned,
            gain=term.gain,
            gain_in_plan=term.gain_in_plan,
            variance=term.variance,
            distance_m=None if term.distance is None else term.distance * scale,
            chance=term.chance,
            helps=tuple(plan.targets[index] for index in term.helps),
            coverage=term.coverage,
            median_frequency=term.median_frequency,
        )
        for term in plan.terms[:_MOST_TERMS]
    )


def _expectation(expectation: engine_records.Expectation) -> Expectation:
    forecast = expectation.forecast
    return Expectation(
        variance=expectation.variance,
        psnr_db=None if forecast is None else forecast.db,
        low_db=None if forecast is None else forecast.low_db,
        high_db=None if forecast is None else forecast.high_db,
    )
