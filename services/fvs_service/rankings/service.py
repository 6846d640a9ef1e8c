"""What can be done with rankings. Never queued: the runner that holds the scene answers at once."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_service.errors import InvalidRequestError, NoSnapshotError, NotFoundError
from fvs_service.events.model import EventKind
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.limiter import AtOnce
from fvs_service.model import now
from fvs_service.principal import Principal, Scope
from fvs_service.rankings import repository
from fvs_service.rankings.generators import Surroundings, generate
from fvs_service.rankings.model import CandidateStatus, RankedCandidate, Ranking, RankingRequest
from fvs_service.rankings.port import (
    DrawView,
    Picture,
    RankedView,
    RankedViews,
    RankViews,
    RunnerView,
    SceneRunners,
)
from fvs_service.rankings.surroundings import pinhole, surroundings, visited_among
from fvs_service.scenes.poses import FramePose, WorldFrame, world_poses
from fvs_service.scenes.repository import SceneHead, find_scene_head, scene_head_of
from fvs_service.settings import Limits
from fvs_service.snapshots.model import Snapshot, SnapshotCameras
from fvs_service.snapshots.repository import find_snapshot
from fvs_service.snapshots.service import Snapshots
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.idempotency import IdempotencyKey

_CACHED_SNAPSHOTS = 64


class Rankings:
    """Ranks candidates, and draws them."""

    def __init__(
        self, database: Database, blobs: Blobs, snapshots: Snapshots, runners: SceneRunners, limits: Limits
    ) -> None:
        self._database = database
        self._blobs = blobs
        self._runners = runners
        self._limits = limits
        self._at_once = AtOnce("rankings", limits.rankings_at_once_per_tenant)
        # Snapshots never change, and each is asked for again and again.
        self._snapshot = lru_cache(_CACHED_SNAPSHOTS)(self._find)
        self._cameras = lru_cache(_CACHED_SNAPSHOTS)(
            lambda snapshot_id: snapshots.cameras(self._snapshot(snapshot_id))
        )
        self._around = lru_cache(_CACHED_SNAPSHOTS)(self._surroundings)

    @property
    def methods(self) -> tuple[str, ...]:
        """The names of all scorers and selectors."""
        return self._runners.methods

    def create(
        self, principal: Principal, scene_id: str, request: RankingRequest, key: str | None = None
    ) -> Ranking:
        """Rank the request's candidates by the newest state of the model, or by a snapshot of it."""
        principal.require(Scope.OPERATE, scene_id)
        remembered = IdempotencyKey(principal.tenant_id, key, f"rankings.create {scene_id}", request)
        with self._database.reading() as session:
            scene = scene_head_of(session, principal, scene_id)
            earlier = remembered.resource_id(session)
            if earlier is not None:
                return repository.ranking_of(session, principal, earlier)
        snapshot_id = request.snapshot_id or scene.snapshot_id
        if snapshot_id is None:
            raise NoSnapshotError(
                "The scene has no model yet, so nothing can be ranked.",
                hint='Run an update (fvs-client update, a job {"kind": "update"}) and wait for its snapshot.',
            )
        snapshot = self._snapshot(snapshot_id)
        if snapshot.scene_id != scene_id:
            raise NotFoundError("There is no such snapshot.")
        self._require_method(request.method)
        with self._at_once.use(principal.tenant_id):
            ranking = self._rank(scene, snapshot, request)
        with self._database.writing() as session:
            earlier = remembered.resource_id(session)
            if earlier is not None:  # the same request, sent twice at once
                return repository.ranking_of(session, principal, earlier)
            repository.add_ranking(session, ranking)
            remembered.remember(session, ranking.id)
            told = {"ranking_id": ranking.id, "snapshot_id": snapshot.id, "method": request.method}
            publish(session, scene_id, EventKind.RANKING_CREATED, told)
        return ranking

    def get(self, principal: Principal, ranking_id: str) -> Ranking:
        """One ranking; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.ranking_of(session, principal, ranking_id)

    def draw(self, principal: Principal, ranking_id: str, candidate_id: str, picture: Picture) -> bytes:
        """A PNG of what a candidate sees, or of its spectrum; drawn once."""
        ranking = self.get(principal, ranking_id)
        candidate = next((item for item in ranking.candidates if item.id == candidate_id), None)
        if candidate is None:
            raise NotFoundError("The ranking has no such candidate.")
        key = f"scenes/{ranking.scene_id}/rankings/{ranking.id}/{candidate.id}/{picture.value}.png"
        if self._blobs.exists(key):
            return self._blobs.read(key)
        with self._database.reading() as session:
            scene = find_scene_head(session, ranking.scene_id)
        frame = WorldFrame(scene.origin, ranking.alignment)
        camera = pinhole(self._cameras(ranking.snapshot_id).camera)
        model_from_camera = frame.model_from_camera(frame.world_from_camera(candidate.pose))
        view = RunnerView(candidate.id, camera, model_from_camera.inverse())
        with self._at_once.use(principal.tenant_id):
            drawn = self._runners.draw(DrawView(scene.id, ranking.snapshot_id, view, picture))
        self._blobs.put(drawn, key)
        return drawn

    def _rank(self, scene: SceneHead, snapshot: Snapshot, request: RankingRequest) -> Ranking:
        cameras: SnapshotCameras = self._cameras(snapshot.id)
        frame = WorldFrame(scene.origin, snapshot.alignment)
        around = self._around(snapshot.id)
        current = (
            None
            if request.current_pose is None
            else frame.world_from_camera(request.current_pose).translation
        )
        poses = self._candidates(request, frame, around, current)
        distances = _distances(poses, current)
        left_out = _left_out(poses, distances, around, request.radius_m)
        camera = pinhole(cameras.camera)
        views = tuple(
            RunnerView(name, camera, frame.model_from_camera(pose).inverse(), distances[name])
            for name, pose in poses.items()
            if name not in left_out
        )
        answer = RankedViews(snapshot.id, snapshot.metrics.iterations, snapshot.metrics.gaussians, ())
        if views:
            answer = self._runners.rank(
                RankViews(
                    scene_id=scene.id,
                    snapshot_id=snapshot.id,
                    method=request.method,
                    views=views,
                    pinned=request.snapshot_id is not None,
                    budget=request.budget,
                    seed=request.seed,
                )
            )
        shown = dict(zip(poses, world_poses(tuple(poses.values())), strict=True))
        places = [_place(view, shown[view.id], distances[view.id]) for view in answer.views]
        places += [
            RankedCandidate(
                id=name,
                rank=None,
                score=None,
                status=status,
                coverage=None,
                distance_m=distances[name],
                pose=shown[name],
            )
            for name, status in left_out.items()
        ]
        return Ranking(
            id=new_id("rnk"),
            scene_id=scene.id,
            snapshot_id=answer.snapshot_id,
            request=request,
            alignment=snapshot.alignment,
            iterations=answer.iterations,
            gaussians=answer.gaussians,
            fallback=answer.fallback,
            candidates=tuple(places[: request.top_k]),
            total=len(places),
            seconds=answer.seconds,
            waited_s=answer.waited_s,
            created_at=now(),
        )

    def _candidates(
        self,
        request: RankingRequest,
        frame: WorldFrame,
        around: Surroundings,
        current: NDArray[np.float64] | None,
    ) -> Mapping[str, RigidTransform]:
        if request.generator is not None:
            poses = generate(request.generator, around, current, request.radius_m)
        else:
            given = request.candidates or ()
            cameras = frame.world_from_cameras([item.pose for item in given])
            poses = {item.id: camera for item, camera in zip(given, cameras, strict=True)}
        if len(poses) > self._limits.candidates_per_ranking:
            raise InvalidRequestError(
                f"There are {len(poses)} candidates; {self._limits.candidates_per_ranking} are allowed.",
                hint="Ask in several rankings.",
            )
        return poses

    def _require_method(self, method: str) -> None:
        if method not in self.methods:
            raise InvalidRequestError(
                f"There is no method {method!r}.", hint=f"These are known: {', '.join(self.methods)}."
            )

    def _surroundings(self, snapshot_id: str) -> Surroundings:
        frame = WorldFrame(None, self._snapshot(snapshot_id).alignment)
        return surroundings(frame, self._cameras(snapshot_id))

    def _find(self, snapshot_id: str) -> Snapshot:
        with self._database.reading() as session:
            return find_snapshot(session, snapshot_id)


def _distances(
    poses: Mapping[str, RigidTransform], current: NDArray[np.float64] | None
) -> dict[str, float | None]:
    if current is None:
        return dict.fromkeys(poses)
    return {name: float(np.linalg.norm(pose.translation - current)) for name, pose in poses.items()}


def _left_out(
    poses: Mapping[str, RigidTransform],
    distances: Mapping[str, float | None],
    around: Surroundings,
    radius: float | None,
) -> dict[str, CandidateStatus]:
    """The candidates that need not be rendered, and why; nearest first, then by id."""
    found: dict[str, CandidateStatus] = {}
    visited = visited_among(poses, around)
    for name in sorted(poses, key=lambda name: (distances[name] or 0.0, name)):
        distance = distances[name]
        if radius is not None and distance is not None and distance > radius:
            found[name] = CandidateStatus.OUT_OF_RANGE
        elif name in visited:
            found[name] = CandidateStatus.VISITED
    return found


def _place(view: RankedView, pose: FramePose, distance_m: float | None) -> RankedCandidate:
    return RankedCandidate(
        id=view.id,
        rank=view.rank,
        score=view.score,
        status=CandidateStatus(view.status),
        coverage=view.coverage,
        distance_m=distance_m,
        pose=pose,
    )
