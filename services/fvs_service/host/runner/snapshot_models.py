"""The models of a scene's snapshots, loaded from their artifacts."""

import shutil
import tempfile
import threading
from collections import OrderedDict
from pathlib import Path

from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.sparse_points import read_observations
from fvs_engine.snapshot_cameras import model_from_cameras, usual_camera
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView, with_share
from fvs_schema.artifacts import CAMERAS, COLMAP, GAUSSIANS, METRICS
from fvs_schema.snapshots import SnapshotCameras, SnapshotMetrics
from fvs_service.snapshots.artifacts import find_artifact
from fvs_service.storage.blobs import Blobs

_KEPT = 2


class SnapshotModels:
    """The models of one scene, whose views have the digests of their images as names; thread-safe."""

    def __init__(self, scene_id: str, blobs: Blobs, rasterizer: Rasterizer) -> None:
        self._scene_id = scene_id
        self._blobs = blobs
        self._rasterizer = rasterizer
        self._lock = threading.Lock()
        self._loaded: OrderedDict[str, SceneModel] = OrderedDict()

    def of_snapshot(self, snapshot_id: str) -> SceneModel:
        """The model of a snapshot; raises ``NotFoundError``."""
        with self._lock:
            found = self._loaded.get(snapshot_id)
            if found is None:
                found = self._loaded[snapshot_id] = self._load(snapshot_id)
                while len(self._loaded) > _KEPT:
                    self._loaded.popitem(last=False)
            self._loaded.move_to_end(snapshot_id)
            return found

    def _load(self, snapshot_id: str) -> SceneModel:
        cameras = SnapshotCameras.model_validate_json(self._read(snapshot_id, CAMERAS))
        with tempfile.TemporaryDirectory(prefix="fvs-") as folder:
            file = Path(folder) / GAUSSIANS
            self._blobs.export(find_artifact(self._blobs, self._scene_id, snapshot_id, GAUSSIANS), file)
            gaussians = read_ply(file).to(self._rasterizer.device)
        metrics = SnapshotMetrics.model_validate_json(self._read(snapshot_id, METRICS))
        return SceneModel(
            gaussians=gaussians,
            sh_degree=gaussians.sh_degree,
            iterations=metrics.iterations,
            views=views_of(cameras),
            read_observations=lambda: self._observations(snapshot_id),
        )

    def _observations(self, snapshot_id: str) -> Observations:
        with tempfile.TemporaryDirectory(prefix="fvs-") as folder:
            file = Path(folder) / COLMAP
            self._blobs.export(find_artifact(self._blobs, self._scene_id, snapshot_id, COLMAP), file)
            shutil.unpack_archive(file, folder)
            (model,) = Path(folder).rglob("points3D.bin")
            return read_observations(model.parent)

    def _read(self, snapshot_id: str, name: str) -> bytes:
        return self._blobs.read(find_artifact(self._blobs, self._scene_id, snapshot_id, name))


def views_of(cameras: SnapshotCameras) -> tuple[PinholeView, ...]:
    """The registered views of a snapshot, named by the digests of their images."""
    camera, poses = usual_camera(cameras), model_from_cameras(cameras)
    return tuple(
        with_share(PinholeView(view.image, camera, pose.inverse()), view.counted_share)
        for view, pose in zip(cameras.views, poses, strict=True)
    )
