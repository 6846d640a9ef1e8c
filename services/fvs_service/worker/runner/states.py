"""The models that questions are answered from: snapshots, and copies of the one that is learning.

Readers take whatever state is the newest and keep it as long as they need: a state never changes.
"""

import tempfile
import threading
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fvs_engine.geometry import PinholeCamera, RigidTransform, matrix_from_quaternion
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_service.snapshots.model import SnapshotCameras, SnapshotMetrics
from fvs_service.snapshots.service import CAMERAS, GAUSSIANS, artifact_key
from fvs_service.storage.blobs import Blobs

METRICS = "metrics.json"
"""The artefact with the snapshot's ``SnapshotMetrics``."""

_KEPT = 2


@dataclass(frozen=True, eq=False)
class State:
    """A model, trained for ``iterations``, that is the snapshot ``snapshot_id`` or grew from it."""

    snapshot_id: str
    gaussians: Gaussians
    sh_degree: int
    cameras: SnapshotCameras
    iterations: int

    @cached_property
    def visited(self) -> tuple[PinholeView, ...]:
        """The views that were photographed; a prefix keeps their ids apart from those of candidates."""
        lens, views = self.cameras.camera, self.cameras.views
        camera = PinholeCamera(lens.width_px, lens.height_px, lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px)
        turns = matrix_from_quaternion(np.array([view.orientation_wxyz for view in views]).reshape(-1, 4))
        return tuple(
            PinholeView(
                f"visited:{view.image}", camera, RigidTransform(turn, np.array(view.position)).inverse()
            )
            for view, turn in zip(views, turns, strict=True)
        )


class States:
    """Finds the state for a question; safe to use from any thread."""

    def __init__(self, scene_id: str, blobs: Blobs, rasterizer: Rasterizer) -> None:
        self._scene_id = scene_id
        self._blobs = blobs
        self._rasterizer = rasterizer
        self._lock = threading.Lock()
        self._loaded: OrderedDict[str, State] = OrderedDict()
        self._live: State | None = None

    def newest(self, snapshot_id: str) -> State:
        """The state that grew farthest from a snapshot."""
        live = self._live
        return live if live is not None and live.snapshot_id == snapshot_id else self.exactly(snapshot_id)

    def exactly(self, snapshot_id: str) -> State:
        """A snapshot; raises ``NotFoundError``."""
        with self._lock:
            state = self._loaded.get(snapshot_id)
            if state is None:
                state = self._loaded[snapshot_id] = self._load(snapshot_id)
                while len(self._loaded) > _KEPT:
                    self._loaded.popitem(last=False)
            self._loaded.move_to_end(snapshot_id)
            return state

    def publish(self, snapshot_id: str, gaussians: Gaussians, sh_degree: int, iterations: int) -> None:
        """Let rankings use a copy of ``gaussians``, which go on changing."""
        copy = Gaussians(**{name: tensor.detach().clone() for name, tensor in gaussians.tensors().items()})
        cameras = self.exactly(snapshot_id).cameras
        self._live = State(snapshot_id, copy, sh_degree, cameras, iterations)

    def forget_live(self) -> None:
        """Go back to snapshots: the learning has ended, one way or another."""
        self._live = None

    def _load(self, snapshot_id: str) -> State:
        cameras = SnapshotCameras.model_validate_json(self._read(snapshot_id, CAMERAS))
        with tempfile.TemporaryDirectory(prefix="fvs-") as folder:
            file = Path(folder) / GAUSSIANS
            self._blobs.place(artifact_key(self._scene_id, snapshot_id, GAUSSIANS), file)
            gaussians = read_ply(file).to(self._rasterizer.device)
        metrics = SnapshotMetrics.model_validate_json(self._read(snapshot_id, METRICS))
        return State(snapshot_id, gaussians, gaussians.sh_degree, cameras, metrics.iterations)

    def _read(self, snapshot_id: str, name: str) -> bytes:
        return self._blobs.read(artifact_key(self._scene_id, snapshot_id, name))
