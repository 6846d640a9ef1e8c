"""Rankings of candidates. They never wait for a job: the scene's runner scores them while it trains."""

from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from anyio.to_thread import run_sync
from numpy.typing import NDArray

from fvs_engine import candidates as engine
from fvs_engine.candidates import CandidateStatus
from fvs_engine.geometry import RigidTransform
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.errors import InvalidRequestError, NotFoundError
from fvs_service.events.model import EventKind
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.model import now
from fvs_service.principal import Principal, Scope
from fvs_service.rankings import repository
from fvs_service.rankings.model import RankedCandidate, Ranking, RankingPart, RankingRequest, ScoredCandidate
from fvs_service.rankings.port import RankedViews, RankViews, RenderView, SceneRunners, ViewImage
from fvs_service.rankings.pose_frames import poses_in
from fvs_service.rankings.scene_geometry import SceneGeometry
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.rankings.warnings import warnings_of
from fvs_service.scenes.lease import find_endpoint
from fvs_service.scenes.poses import FramePose, VehiclePose, WorldFrame
from fvs_service.scenes.repository import SceneHead, find_scene_head, scene_head_of
from fvs_service.settings import Limits
from fvs_service.snapshots.model import Snapshot
from fvs_service.snapshots.repository import snapshot_of
from fvs_service.storage.blob_keys import ranking_prefix
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database, Reader
from fvs_service.storage.idempotency import IdempotencyKey
from fvs_service.storage.removals import ABANDONED_AFTER, has_row, keep, remove_later

ReadRequest: TypeAlias = Callable[[], RankingRequest]
"""Gives a request; it is called in a thread, once the permission is checked."""
TakenPoses: TypeAlias = Callable[[Reader, str, str | None], Sequence[FramePose | VehiclePose]]
"""The poses in a scene that are taken for a vehicle, or for one without a name."""


@dataclass(frozen=True)
class _Prepared:
    """What is known of a ranking before its candidates are scored.

    By id: the ``poses`` of the answer, and the distances. What can be done before scoring is done before: it
    takes several times as long afterwards, when scoring has replaced what the processor's caches held.
    """

    request: RankingRequest
    scene: SceneHead
    snapshot: Snapshot
    frame: WorldFrame
    poses: Mapping[str, FramePose | VehiclePose]
    distances: Mapping[str, float]
    excluded: Mapping[str, engine.RankedCandidate]
    question: RankViews
    remembered: IdempotencyKey


class Rankings:
    """Ranks candidates and renders them.

    Results are kept: ``require_room`` raises ``OutOfSpaceError`` when there is no room for another one.
    """

    def __init__(
        self,
        database: Database,
        blobs: Blobs,
        frames: SnapshotFrames,
        runners: SceneRunners,
        limits: Limits,
        taken_poses: TakenPoses,
        require_room: Callable[[], object] = lambda: None,
    ) -> None:
        self._taken_poses = taken_poses
        self._require_room = require_room
        self._database = database
        self._blobs = blobs
        self._runners = runners
        self._limits = limits
        self._limit = ConcurrencyLimit("rankings", limits.rankings_at_once_per_tenant)
        self._frames = frames

    @property
    def methods(self) -> tuple[str, ...]:
        """The names of all scorers and selectors."""
        return self._runners.methods

    async def create(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None = None,
    ) -> Ranking:
        """Rank the request's candidates with the newest state of the model, or with one of its snapshots.

        Cancelling it stops the computation. Raises ``DeadlineError`` when it takes longer than ``timeout_s``.
        """
        with self._limit.slot(principal.tenant_id):
            prepared = await run_sync(self._prepare, principal, scene_id, read, timeout_s, key)
            if isinstance(prepared, Ranking):
                return prepared
            question = prepared.question
            result = await self._runners.rank(question) if question.views else _unscored(prepared.snapshot)
            return await run_sync(self._finish, principal, prepared, result)

    async def stream(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None = None,
    ) -> AsyncGenerator[RankingPart, None]:
        """Rank candidates as ``create`` does; yields those that are scored, and last the ranking."""
        with self._limit.slot(principal.tenant_id):
            prepared = await run_sync(self._prepare, principal, scene_id, read, timeout_s, key)
            if isinstance(prepared, Ranking):
                yield RankingPart(ranking=prepared)
                return
            result = _unscored(prepared.snapshot)
            if prepared.question.views:
                async with aclosing(self._runners.stream(prepared.question)) as parts:
                    async for part in parts:
                        if isinstance(part, RankedViews):
                            result = part
                        else:
                            yield RankingPart(candidates=await run_sync(_scored, prepared, part))
            yield RankingPart(ranking=await run_sync(self._finish, principal, prepared, result))

    def get(self, principal: Principal, ranking_id: str) -> Ranking:
        """One ranking; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.ranking_of(session, principal, ranking_id)

    async def render(
        self, principal: Principal, ranking_id: str, candidate_id: str, image: ViewImage, timeout_s: float
    ) -> bytes:
        """A PNG of a candidate's view, or of its spectrum; made once."""
        with self._limit.slot(principal.tenant_id):
            prepared = await run_sync(
                self._prepare_render, principal, ranking_id, candidate_id, image, timeout_s
            )
            if isinstance(prepared, bytes):
                return prepared
            png = await self._runners.render(prepared)
            await run_sync(
                self._keep_render, png, _render_key(ranking_id, candidate_id, prepared), prepared.scene_id
            )
            return png

    def _prepare(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None,
    ) -> _Prepared | Ranking:
        """What to ask the runner, or the ranking that was made with the same idempotency key."""
        principal.require(Scope.OPERATE, scene_id)
        with self._database.querying() as reader:
            scene = scene_head_of(reader, principal, scene_id)
            request = read()
            remembered = IdempotencyKey(principal.tenant_id, key, f"rankings.create {scene_id}", request)
            earlier = self._earlier(reader, principal, remembered)
            if earlier is not None:
                return earlier
            endpoint = find_endpoint(reader, scene_id)
            taken_poses = self._taken_poses(reader, scene_id, request.for_vehicle)
        snapshot = self._frames.snapshot(principal, scene, request.snapshot_id)
        request = request.complete
        self._require_method(request.method)
        frame = self._frames.frame(snapshot.id, scene.origin)
        if request.frame == "geodetic":
            frame.require_origin()
        geometry = self._frames.geometry(snapshot.id)
        current = (
            None
            if request.current_pose is None
            else frame.world_from_camera(request.current_pose).translation
        )
        poses = self._frames.candidates(
            request.candidates,
            request.generator,
            frame,
            geometry,
            current=current,
            radius_m=request.radius_m,
        )
        distances = _distances(poses, current)
        taken = taken_cameras(frame, taken_poses)
        excluded = _excluded(poses, distances, geometry, taken, request.radius_m)
        scored = {name: pose for name, pose in poses.items() if name not in excluded}
        later = {
            name: poses[name]
            for name, candidate in excluded.items()
            if candidate.status is CandidateStatus.OUT_OF_RANGE
        }
        scale = frame.world_from_model.scale
        camera = self._frames.cameras(snapshot.id).camera.pinhole
        question = RankViews(
            scene_id=scene.id,
            endpoint=endpoint,
            snapshot_id=snapshot.id,
            api_key=principal.key_id,
            timeout_s=timeout_s,
            method=request.method,
            views=frame.views(scored, camera),
            distances={name: distances[name] for name in scored if name in distances},
            taken=frame.views(taken, camera),
            later=frame.views(later, camera),
            here=None if current is None else tuple(frame.model_from_world.apply(current).tolist()),
            reach=None if request.radius_m is None else request.radius_m / scale,
            budget=request.budget,
            seed=request.seed,
        )
        self._require_room()
        given = request.candidates or ()
        answered = poses_in(frame, tuple(poses), poses, given, request.frame, request.current_pose)
        shown = dict(zip(poses, answered, strict=True))
        return _Prepared(request, scene, snapshot, frame, shown, distances, excluded, question, remembered)

    def _finish(self, principal: Principal, prepared: _Prepared, result: RankedViews) -> Ranking:
        """Keep the ranking that the runner's result makes."""
        request, scene_id, snapshot = prepared.request, prepared.scene.id, prepared.snapshot
        first = (*result.candidates, *prepared.excluded.values())[: request.top_k]
        ranking = Ranking(
            id=new_id("rnk"),
            scene_id=scene_id,
            snapshot_id=result.snapshot_id,
            request=request,
            alignment=snapshot.alignment,
            origin=prepared.scene.origin if prepared.frame.georeferenced else None,
            iterations=result.iterations,
            gaussians=result.gaussians,
            fallback=result.fallback,
            candidates=tuple(RankedCandidate.ranked(one, prepared.poses[one.name]) for one in first),
            total=len(prepared.poses),
            seconds=result.seconds,
            waited_s=result.waited_s,
            warnings=warnings_of(
                snapshot.alignment,
                in_model=request.in_model,
                candidates=len(result.candidates),
                registrable=result.registrable,
            ),
            created_at=now(),
        )
        # A ranking that a power cut undoes can be asked for again; a sync would take as long as all else.
        with self._database.writing(principal.tenant_id, scene_id, durable=False) as session:
            scene_head_of(session, principal, scene_id)  # it may have been deleted meanwhile
            earlier = self._earlier(session, principal, prepared.remembered)
            if earlier is not None:  # the same request, sent twice at once
                return earlier
            repository.add_ranking(session, ranking)
            prepared.remembered.remember(session, ranking.id)
            data = {"ranking_id": ranking.id, "snapshot_id": snapshot.id, "method": request.method}
            publish(session, scene_id, EventKind.RANKING_CREATED, data)
        return ranking

    def _prepare_render(
        self, principal: Principal, ranking_id: str, candidate_id: str, image: ViewImage, timeout_s: float
    ) -> RenderView | bytes:
        """What to ask the runner; the PNG, if it was made before."""
        ranking = self.get(principal, ranking_id)
        candidate = next((item for item in ranking.candidates if item.id == candidate_id), None)
        if candidate is None:
            raise NotFoundError("The ranking has no such candidate.")
        with self._database.reading() as session:
            scene = find_scene_head(session, ranking.scene_id)
            snapshot_of(session, principal, ranking.snapshot_id)
            endpoint = find_endpoint(session, scene.id)
        frame = WorldFrame(scene.origin, ranking.alignment)
        camera = self._frames.cameras(ranking.snapshot_id).camera.pinhole
        (view,) = frame.views({candidate.id: frame.world_from_camera(candidate.pose)}, camera)
        question = RenderView(
            scene_id=scene.id,
            endpoint=endpoint,
            snapshot_id=ranking.snapshot_id,
            api_key=principal.key_id,
            timeout_s=timeout_s,
            view=view,
            image=image,
        )
        key = _render_key(ranking_id, candidate_id, question)
        if self._blobs.exists(key):
            return self._blobs.read(key)
        self._require_room()
        return question

    def _keep_render(self, png: bytes, key: str, scene_id: str) -> None:
        """Store a render, unless its ranking was deleted meanwhile."""
        # Durable, and with it the ranking: a power cut must not undo that after the render is on the disk.
        with self._database.writing(scene_id) as session:
            if not has_row(session, key):
                return
            remove_later(session, scene_id, key, after=ABANDONED_AFTER)
        self._blobs.put(png, key)
        with self._database.writing(scene_id, durable=False) as session:
            if has_row(session, key):
                keep(session, [key])
            else:
                self._blobs.remove(key)

    def _earlier(self, reader: Reader, principal: Principal, key: IdempotencyKey) -> Ranking | None:
        """The ranking that an earlier request with the same idempotency key made."""
        return key.resource(reader, lambda made: repository.ranking_of(reader, principal, made))

    def _require_method(self, method: str) -> None:
        if method not in self.methods:
            raise InvalidRequestError(
                f"There is no method {method!r}.", hint=f"The methods are {', '.join(self.methods)}."
            )


def _scored(prepared: _Prepared, scores: Sequence[engine.CandidateScore]) -> tuple[ScoredCandidate, ...]:
    """Scored candidates as the client asked for them."""
    poses, distances = prepared.poses, prepared.distances
    return tuple(ScoredCandidate.of(one, distances.get(one.name), poses[one.name]) for one in scores)


def _unscored(snapshot: Snapshot) -> RankedViews:
    """The result when no candidate is to be scored."""
    metrics = snapshot.metrics
    return RankedViews(snapshot_id=snapshot.id, iterations=metrics.iterations, gaussians=metrics.gaussians)


def _render_key(ranking_id: str, candidate_id: str, question: RenderView) -> str:
    return f"{ranking_prefix(question.scene_id, ranking_id)}{candidate_id}/{question.image.value}.png"


def taken_cameras(frame: WorldFrame, poses: Sequence[FramePose | VehiclePose]) -> dict[str, RigidTransform]:
    """World_from_camera by a name that is no candidate's, for the poses that the frame knows."""
    return {f"taken:{number}": camera for number, camera in enumerate(frame.known_cameras(poses))}


def _distances(poses: Mapping[str, RigidTransform], current: NDArray[np.float64] | None) -> dict[str, float]:
    """Distances from the current camera centre by id; empty without one."""
    if current is None:
        return {}
    return {name: float(np.linalg.norm(pose.translation - current)) for name, pose in poses.items()}


def _excluded(
    poses: Mapping[str, RigidTransform],
    distances: Mapping[str, float],
    geometry: SceneGeometry,
    taken: Mapping[str, RigidTransform],
    radius: float | None,
) -> dict[str, engine.RankedCandidate]:
    """The candidates that are not scored, by id; nearest first, then by id."""
    found: dict[str, engine.RankedCandidate] = {}
    visited = geometry.visited(poses)
    taken_views = geometry.same_view(poses, tuple(taken.values()))
    for name in sorted(poses, key=lambda name: (distances.get(name, 0.0), name)):
        distance = distances.get(name)
        if name in visited:
            status = CandidateStatus.VISITED
        elif name in taken_views:
            status = CandidateStatus.TAKEN
        elif radius is not None and distance is not None and distance > radius:
            status = CandidateStatus.OUT_OF_RANGE
        else:
            continue
        found[name] = engine.RankedCandidate(None, name, None, status, None, distance)
    return found
