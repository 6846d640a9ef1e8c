"""Preparation of a ranking: the request to the runner, and everything that is known before scoring."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Self, TypeAlias, TypeVar

import numpy as np
from anyio.to_thread import run_sync
from numpy.typing import NDArray

from fvs_engine import candidates as engine
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.ground import GroundCheck
from fvs_engine.snapshot_cameras import usual_camera
from fvs_schema.candidates import CandidateStatus, InVolume
from fvs_schema.forecasts import ForecastRequest
from fvs_schema.plans import PlanRequest
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.rankings import RankingRequest
from fvs_schema.snapshots import Snapshot
from fvs_schema.terrain import AnyTerrain, Terrain
from fvs_service.principal import Principal
from fvs_service.rankings.in_model import clearance, views_in_volume
from fvs_service.rankings.port import Clearance, GenerateViews, RankViews, SceneRunners
from fvs_service.rankings.pose_frames import in_world, poses_in
from fvs_service.rankings.scene_geometry import SceneGeometry
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.rankings.under_ground import ground_check
from fvs_service.scenes.poses import WorldFrame
from fvs_service.scenes.repository import SceneHead
from fvs_service.storage.database import Reader
from fvs_service.storage.idempotency import IdempotencyKey

TakenPoses: TypeAlias = Callable[[Reader, str, str | None], Sequence[FramePose | VehiclePose]]
"""The poses in a scene that are taken for a vehicle, or for one without a name."""
RequestT = TypeVar("RequestT", RankingRequest, PlanRequest, ForecastRequest)


@dataclass(frozen=True)
class PreparedRanking:
    """The validated input of a ranking, whose candidates the runner then scores.

    By id: the ``poses`` of the answer, and the distances. Whatever can be prepared before scoring is:
    afterwards it takes several times as long, because scoring has displaced the processor's caches.
    """

    request: RankingRequest
    scene: SceneHead
    snapshot: Snapshot
    frame: WorldFrame
    poses: Mapping[str, FramePose | VehiclePose]
    distances: Mapping[str, float]
    excluded: Mapping[str, engine.RankedCandidate]
    ground: GroundCheck
    model_request: RankViews
    remembered: IdempotencyKey


@dataclass(frozen=True)
class Begun(Generic[RequestT]):
    """A ranking, a plan or a forecast before its candidates are known.

    ``taken`` are world_from_camera of views that count as visited, by names that no candidate has.
    """

    principal: Principal
    request: RequestT
    scene: SceneHead
    endpoint: str | None
    snapshot: Snapshot
    frame: WorldFrame
    geometry: SceneGeometry
    camera: PinholeCamera
    taken: Mapping[str, RigidTransform]
    terrain: Terrain | None
    timeout_s: float
    remembered: IdempotencyKey

    @classmethod
    def of(
        cls,
        frames: SnapshotFrames,
        principal: Principal,
        request: RequestT,
        scene: SceneHead,
        endpoint: str | None,
        taken_poses: Sequence[FramePose | VehiclePose],
        terrain: AnyTerrain | None,
        timeout_s: float,
        remembered: IdempotencyKey,
    ) -> Self:
        """Begin with the snapshot of a request, and with its default generator where it has no candidates.

        Raises ``NoSnapshotError``, ``NotFoundError`` for an unknown snapshot, and ``InvalidRequestError`` for
        geodetic poses or a terrain that the scene cannot have, and for too many candidates.
        """
        request = request.complete
        snapshot = frames.snapshot(principal, scene, request.snapshot_id)
        frame = frames.frame(snapshot.id, scene.origin)
        if request.frame == "geodetic":
            frame.require_origin()
        if isinstance(request.generator, InVolume):
            frames.require_few(request.generator.count)
        return cls(
            principal=principal,
            request=request,
            scene=scene,
            endpoint=endpoint,
            snapshot=snapshot,
            frame=frame,
            geometry=frames.geometry(snapshot.id),
            camera=usual_camera(frames.cameras(snapshot.id)),
            taken=taken_cameras(frame, taken_poses),
            terrain=frames.terrain(terrain, snapshot.id, frame),
            timeout_s=timeout_s,
            remembered=remembered,
        )

    @cached_property
    def clearance(self) -> Clearance:
        """Where vehicles may be, in the model frame; raises ``InvalidRequestError`` as ``generated``."""
        request = self.request
        if isinstance(request, ForecastRequest):
            return Clearance()
        return clearance(request.safety_m, request.no_fly, self.frame)

    async def generated(self, runners: SceneRunners) -> tuple[Mapping[str, RigidTransform], float]:
        """Candidates in the request's volume (id → world_from_camera), and the seconds that they took.

        Raises ``InvalidRequestError`` for volumes that cannot be used in the model frame.
        """
        began = time.monotonic()
        generated = await runners.generate(await run_sync(self._generation))
        poses = await run_sync(in_world, generated.views, self.frame)
        return poses, time.monotonic() - began

    def above_ground(
        self, poses: Mapping[str, RigidTransform], but: Collection[str]
    ) -> tuple[GroundCheck, Mapping[str, RigidTransform]]:
        """Compare candidates (id → world_from_camera), ``but`` some, with the terrain, if there is one.

        Returns also those of them that are not under it.
        """
        left = {name: pose for name, pose in poses.items() if name not in but}
        ground = ground_check(left, self.frame, self.terrain)
        under = frozenset(ground.under)
        return ground, {name: pose for name, pose in left.items() if name not in under}

    def _generation(self) -> GenerateViews:
        request, frame = self.request, self.frame
        assert isinstance(request.generator, InVolume)
        return GenerateViews(
            scene_id=self.scene.id,
            endpoint=self.endpoint,
            snapshot_id=self.snapshot.id,
            api_key=self.principal.key_id,
            timeout_s=self.timeout_s,
            views=views_in_volume(request.generator, frame, self.geometry.up, self.camera),
            clearance=self.clearance,
        )


@dataclass(frozen=True)
class BegunRanking(Begun[RankingRequest]):
    """A ranking before its candidates are known."""

    @cached_property
    def current(self) -> NDArray[np.float64] | None:
        """Where the vehicle is in the world [3]; None where the request does not say."""
        pose = self.request.current_pose
        return None if pose is None else self.frame.world_from_camera(pose).translation

    def prepared(self, poses: Mapping[str, RigidTransform], spent_s: float = 0.0) -> PreparedRanking:
        """The ranking of candidates at ``poses`` (id → world_from_camera), which took ``spent_s`` to find."""
        request, frame, current = self.request, self.frame, self.current
        distances = _distances(poses, current)
        visited = self.geometry.visited(poses)
        taken = self.geometry.same_view(poses, tuple(self.taken.values()))
        ground, _ = self.above_ground(poses, visited | taken)
        excluded = _excluded(poses, distances, visited, taken, frozenset(ground.under), request.radius_m)
        scored = {name: pose for name, pose in poses.items() if name not in excluded}
        later = {
            name: poses[name]
            for name, candidate in excluded.items()
            if candidate.status is CandidateStatus.OUT_OF_RANGE
        }
        model_request = RankViews(
            scene_id=self.scene.id,
            endpoint=self.endpoint,
            snapshot_id=self.snapshot.id,
            api_key=self.principal.key_id,
            timeout_s=max(0.0, self.timeout_s - spent_s),
            method=request.method,
            views=frame.views(scored, self.camera),
            clearance=self.clearance,
            rank_all=request.rank_all,
            distances={name: distances[name] for name in scored if name in distances},
            taken=frame.views(self.taken, self.camera),
            later=frame.views(later, self.camera),
            here=None if current is None else tuple(frame.model_from_world.apply(current).tolist()),
            reach=None if request.radius_m is None else request.radius_m / frame.world_from_model.scale,
            budget=request.budget,
            seed=request.seed,
        )
        given = request.candidates or ()
        answered = poses_in(frame, tuple(poses), poses, given, request.frame, request.current_pose)
        return PreparedRanking(
            request,
            self.scene,
            self.snapshot,
            frame,
            dict(zip(poses, answered, strict=True)),
            distances,
            excluded,
            ground,
            model_request,
            self.remembered,
        )


def taken_cameras(frame: WorldFrame, poses: Sequence[FramePose | VehiclePose]) -> dict[str, RigidTransform]:
    """world_from_camera of the known poses, by names that no candidate has."""
    return {f"taken:{number}": camera for number, camera in enumerate(frame.known_cameras(poses))}


def _distances(poses: Mapping[str, RigidTransform], current: NDArray[np.float64] | None) -> dict[str, float]:
    """Distances from the current camera centre by id; empty without one."""
    if current is None:
        return {}
    return {name: float(np.linalg.norm(pose.translation - current)) for name, pose in poses.items()}


def _excluded(
    poses: Mapping[str, RigidTransform],
    distances: Mapping[str, float],
    visited: Collection[str],
    taken: Collection[str],
    below: Collection[str],
    radius: float | None,
) -> dict[str, engine.RankedCandidate]:
    """The candidates that are not scored, by id; nearest first, then by id."""
    found: dict[str, engine.RankedCandidate] = {}
    for name in sorted(poses, key=lambda name: (distances.get(name, 0.0), name)):
        distance = distances.get(name)
        if name in visited:
            status = CandidateStatus.VISITED
        elif name in taken:
            status = CandidateStatus.TAKEN
        elif name in below:
            status = CandidateStatus.UNDER_GROUND
        elif radius is not None and distance is not None and distance > radius:
            status = CandidateStatus.OUT_OF_RANGE
        else:
            continue
        found[name] = engine.RankedCandidate(None, name, None, status, None, distance)
    return found
