"""The snapshots of a scene's model that rank, loaded."""

import shutil
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fvs_engine.plan.clearance import Matter
from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.matter import matter_of
from fvs_engine.scene.observations import read_observations
from fvs_engine.score.feasibility import FeasibilityCheck
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_service.snapshots.artifacts import CAMERAS, COLMAP, GAUSSIANS, METRICS, find_artifact
from fvs_service.snapshots.model import SnapshotCameras, SnapshotMetrics
from fvs_service.storage.blobs import Blobs

_KEPT = 2


@dataclass(frozen=True, eq=False)
class ModelState:
    """The model of the snapshot ``snapshot_id``, after ``iterations``; it never changes."""

    snapshot_id: str
    gaussians: Gaussians
    sh_degree: int
    cameras: SnapshotCameras
    iterations: int
    read_observations: Callable[[], Observations]
    """Reads the sparse points, which rankings and plans need, and renders do not."""

    @cached_property
    def visited(self) -> tuple[PinholeView, ...]:
        """The visited views; a prefix keeps their names apart from those of candidates."""
        camera = self.cameras.camera.pinhole
        return tuple(
            PinholeView(f"visited:{view.image}", camera, model_from_camera.inverse())
            for view, model_from_camera in zip(
                self.cameras.views, self.cameras.model_from_cameras(), strict=True
            )
        )

    @cached_property
    def matter(self) -> Matter:
        """The matter that the Gaussians show."""
        return matter_of(self.gaussians)

    @cached_property
    def feasibility(self) -> FeasibilityCheck:
        """Whether candidates can be photographed and registered."""
        return FeasibilityCheck(self.gaussians, self.visited, self.observations)

    @cached_property
    def observations(self) -> Observations:
        """The sparse points and the cameras that saw them."""
        return self.read_observations()


class ModelStates:
    """The states of one scene; safe to use from any thread."""

    def __init__(self, scene_id: str, blobs: Blobs, rasterizer: Rasterizer) -> None:
        self._scene_id = scene_id
        self._blobs = blobs
        self._rasterizer = rasterizer
        self._lock = threading.Lock()
        self._loaded: OrderedDict[str, ModelState] = OrderedDict()

    def of_snapshot(self, snapshot_id: str) -> ModelState:
        """The state of a snapshot; raises ``NotFoundError``."""
        with self._lock:
            state = self._loaded.get(snapshot_id)
            if state is None:
                state = self._loaded[snapshot_id] = self._load(snapshot_id)
                while len(self._loaded) > _KEPT:
                    self._loaded.popitem(last=False)
            self._loaded.move_to_end(snapshot_id)
            return state

    def _load(self, snapshot_id: str) -> ModelState:
        cameras = SnapshotCameras.model_validate_json(self._read(snapshot_id, CAMERAS))
        with tempfile.TemporaryDirectory(prefix="fvs-") as folder:
            file = Path(folder) / GAUSSIANS
            self._blobs.export(find_artifact(self._blobs, self._scene_id, snapshot_id, GAUSSIANS), file)
            gaussians = read_ply(file).to(self._rasterizer.device)
        metrics = SnapshotMetrics.model_validate_json(self._read(snapshot_id, METRICS))
        return ModelState(
            snapshot_id,
            gaussians,
            gaussians.sh_degree,
            cameras,
            metrics.iterations,
            lambda: self._observations(snapshot_id),
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
