"""Renders: of candidates, which are kept, and of a snapshot at any pose, which are not."""

from collections.abc import Callable

from anyio.to_thread import run_sync

from fvs_engine.geometry import PinholeCamera
from fvs_engine.snapshot_cameras import usual_camera
from fvs_engine.views import PinholeView
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.renders import RenderRequest, ViewImage
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.port import RenderView, SceneRunners
from fvs_service.rankings.repository import ranking_of
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.scenes.lease import find_endpoint
from fvs_service.scenes.poses import WorldFrame, require_on_earth
from fvs_service.scenes.repository import find_scene_head
from fvs_service.snapshots.repository import snapshot_of
from fvs_service.storage.blob_keys import ranking_prefix
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.removals import ABANDONED_AFTER, has_row, keep, remove_later

_NAME = "the view"


class Renders:
    """Renders views with the models of snapshots.

    Those of candidates are kept: ``require_room`` raises ``OutOfSpaceError`` when there is no room for
    another one.
    """

    def __init__(
        self,
        database: Database,
        blobs: Blobs,
        frames: SnapshotFrames,
        runners: SceneRunners,
        limit: ConcurrencyLimit,
        require_room: Callable[[], object] = lambda: None,
    ) -> None:
        self._database = database
        self._blobs = blobs
        self._frames = frames
        self._runners = runners
        self._limit = limit
        self._require_room = require_room

    async def at_pose(
        self, principal: Principal, snapshot_id: str, read: Callable[[], RenderRequest], timeout_s: float
    ) -> tuple[bytes, str]:
        """The image of a snapshot at the request's pose, and its media type.

        ``read`` is called in a thread, once the snapshot is known to exist. Cancelling it stops the
        computation. Raises ``NotFoundError``, ``InvalidRequestError`` for a geodetic pose where the scene has
        no place on Earth, and what runners raise.
        """
        with self._limit.slot(principal.tenant_id):
            model_request = await run_sync(self._prepare, principal, snapshot_id, read, timeout_s)
            return await self._runners.render(model_request), model_request.format.media_type

    async def of_candidate(
        self, principal: Principal, ranking_id: str, candidate_id: str, image: ViewImage, timeout_s: float
    ) -> bytes:
        """A PNG of a candidate's view, or of its spectrum; made once."""
        with self._limit.slot(principal.tenant_id):
            prepared = await run_sync(
                self._prepare_candidate, principal, ranking_id, candidate_id, image, timeout_s
            )
            if isinstance(prepared, bytes):
                return prepared
            png = await self._runners.render(prepared)
            await run_sync(self._keep, png, _key(ranking_id, candidate_id, prepared), prepared.scene_id)
            return png

    def _prepare(
        self, principal: Principal, snapshot_id: str, read: Callable[[], RenderRequest], timeout_s: float
    ) -> RenderView:
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            snapshot = snapshot_of(session, principal, snapshot_id)
            scene = find_scene_head(session, snapshot.scene_id)
            endpoint = find_endpoint(session, scene.id)
        request = read()
        frame = self._frames.frame(snapshot_id, scene.origin)
        camera = usual_camera(self._frames.cameras(snapshot_id))
        return RenderView(
            scene_id=scene.id,
            endpoint=endpoint,
            snapshot_id=snapshot_id,
            api_key=principal.key_id,
            timeout_s=timeout_s,
            view=_view(frame, request.pose, _sized(camera, request.long_side_px)),
            image=request.image,
            format=request.format,
        )

    def _prepare_candidate(
        self, principal: Principal, ranking_id: str, candidate_id: str, image: ViewImage, timeout_s: float
    ) -> RenderView | bytes:
        """The request to the runner; or the PNG, if it was made before."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            ranking = ranking_of(session, principal, ranking_id)
            candidate = next((item for item in ranking.candidates if item.id == candidate_id), None)
            if candidate is None:
                raise NotFoundError("The ranking has no such candidate.")
            scene = find_scene_head(session, ranking.scene_id)
            snapshot_of(session, principal, ranking.snapshot_id)
            endpoint = find_endpoint(session, scene.id)
        frame = WorldFrame(scene.origin, ranking.alignment)
        camera = usual_camera(self._frames.cameras(ranking.snapshot_id))
        model_request = RenderView(
            scene_id=scene.id,
            endpoint=endpoint,
            snapshot_id=ranking.snapshot_id,
            api_key=principal.key_id,
            timeout_s=timeout_s,
            view=_view(frame, candidate.pose, camera),
            image=image,
        )
        key = _key(ranking_id, candidate_id, model_request)
        if self._blobs.exists(key):
            return self._blobs.read(key)
        self._require_room()
        return model_request

    def _keep(self, png: bytes, key: str, scene_id: str) -> None:
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


def _view(frame: WorldFrame, pose: FramePose | VehiclePose, camera: PinholeCamera) -> PinholeView:
    """The view of a pose; its name is always the same, so that equal requests are recognised."""
    poses = {_NAME: frame.world_from_camera(pose)}
    require_on_earth(poses)
    (view,) = frame.views(poses, camera)
    return view


def _sized(camera: PinholeCamera, long_side_px: int | None) -> PinholeCamera:
    if long_side_px is None:
        return camera
    scale = long_side_px / max(camera.width, camera.height)
    return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))


def _key(ranking_id: str, candidate_id: str, model_request: RenderView) -> str:
    return (
        f"{ranking_prefix(model_request.scene_id, ranking_id)}{candidate_id}/{model_request.image.value}.png"
    )
