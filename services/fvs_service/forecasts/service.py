"""Forecasts of views and of the surface. They never wait for a job: the scene's runner makes them."""

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from anyio.to_thread import run_sync

from fvs_engine.geometry import RigidTransform
from fvs_engine.plan.plan_records import Expectation
from fvs_schema.candidates import InVolume
from fvs_schema.forecasts import Forecast, ForecastRequest, ForecastSample, FramePosition, GeodeticPosition
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.service import Limits
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.in_model import require_volumes
from fvs_service.rankings.port import ForecastViews, SceneRunners, ViewForecasts
from fvs_service.rankings.pose_frames import poses_in
from fvs_service.rankings.preparation import Begun
from fvs_service.rankings.snapshot_frames import SnapshotFrames, by_id
from fvs_service.scenes.lease import find_endpoint
from fvs_service.scenes.poses import require_on_earth
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.database import Database
from fvs_service.storage.idempotency import IdempotencyKey

ReadRequest: TypeAlias = Callable[[], ForecastRequest]
"""Reads a request; it is called in a thread, after the permission check."""
_Poses: TypeAlias = Mapping[str, RigidTransform]
"""world_from_camera by candidate id; none for the surface."""


class Forecasts:
    """Makes forecasts; nothing is stored."""

    def __init__(
        self, database: Database, frames: SnapshotFrames, runners: SceneRunners, limits: Limits
    ) -> None:
        self._database = database
        self._frames = frames
        self._runners = runners
        self._limit = ConcurrencyLimit("rankings", limits.rankings_at_once_per_tenant)

    async def create(
        self, principal: Principal, scene_id: str, read: ReadRequest, timeout_s: float
    ) -> Forecast:
        """Forecast views, or the surface, with the newest model of a scene or one of its snapshots.

        Cancelling it gives up waiting. Raises ``NoSnapshotError``, ``InvalidRequestError``, and
        ``DeadlineError`` when it takes longer than ``timeout_s``.
        """
        with self._limit.slot(principal.tenant_id):
            begun = await run_sync(self._begin, principal, scene_id, read, timeout_s)
            found, spent_s = None, 0.0
            if isinstance(begun.request.generator, InVolume):
                found, spent_s = await begun.generated(self._runners)
            poses, model_request = await run_sync(self._prepare, begun, found, spent_s)
            made = await self._runners.forecast(model_request)
            return await run_sync(_forecast, begun, poses, made)

    def _begin(
        self, principal: Principal, scene_id: str, read: ReadRequest, timeout_s: float
    ) -> Begun[ForecastRequest]:
        principal.require(Scope.READ, scene_id)
        with self._database.querying() as reader:
            scene = scene_head_of(reader, principal, scene_id)
            request = read()
            require_volumes(request.generator)
            endpoint = find_endpoint(reader, scene_id)
        unkept = IdempotencyKey(principal.tenant_id, None, "forecasts.create", request)
        return Begun.of(self._frames, principal, request, scene, endpoint, (), None, timeout_s, unkept)

    def _prepare(
        self, begun: Begun[ForecastRequest], found: _Poses | None, spent_s: float
    ) -> tuple[_Poses, ForecastViews]:
        """The poses of the candidates and the request to the runner.

        ``found`` are candidates in a volume, which took ``spent_s``.
        """
        request, frame, generator = begun.request, begun.frame, begun.request.generator
        poses: _Poses = {}
        if found is not None:
            poses = found
        elif request.surface is None:
            assert not isinstance(generator, InVolume)
            poses = self._frames.candidates(request.candidates, generator, frame, begun.geometry)
        after = {f"after:{name}": pose for name, pose in by_id(request.after, frame).items()}
        require_on_earth(after)
        return poses, ForecastViews(
            scene_id=begun.scene.id,
            endpoint=begun.endpoint,
            snapshot_id=begun.snapshot.id,
            api_key=begun.principal.key_id,
            timeout_s=max(0.0, begun.timeout_s - spent_s),
            views=frame.views(poses, begun.camera),
            surface=None if request.surface is None else request.surface.count,
            after=frame.views(after, begun.camera),
            updates=self._frames.updates(begun.scene.id),
        )


def _forecast(begun: Begun[ForecastRequest], poses: _Poses, made: ViewForecasts) -> Forecast:
    """The answer, with poses or positions in the frame of the request."""
    request, frame = begun.request, begun.frame
    if request.surface is None:
        shown = poses_in(frame, tuple(poses), poses, request.candidates or (), request.frame, None)
        samples = [
            _sample(name, expected, pose=pose)
            for name, pose, expected in zip(poses, shown, made.views, strict=True)
        ]
    else:
        wanted = request.frame or ("geodetic" if frame.georeferenced else "world")
        positions = frame.positions(np.array(made.places).reshape(-1, 3), wanted)
        samples = [
            _sample(f"surface-{number:05d}", expected, position=position)
            for number, (position, expected) in enumerate(zip(positions, made.views, strict=True))
        ]
    return Forecast(
        scene_id=begun.scene.id,
        snapshot_id=begun.snapshot.id,
        calibrated=made.calibrated,
        samples=tuple(samples),
        alignment=begun.snapshot.alignment,
        origin=begun.scene.origin if frame.georeferenced else None,
    )


def _sample(
    name: str,
    expected: Expectation,
    pose: FramePose | VehiclePose | None = None,
    position: FramePosition | GeodeticPosition | None = None,
) -> ForecastSample:
    forecast = expected.forecast
    return ForecastSample(
        id=name,
        pose=pose,
        position=position,
        variance=expected.variance,
        psnr_db=None if forecast is None else forecast.db,
        low_db=None if forecast is None else forecast.low_db,
        high_db=None if forecast is None else forecast.high_db,
    )
