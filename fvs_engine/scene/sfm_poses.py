"""Poses by structure from motion on the visited photographs only."""

from collections.abc import Sequence
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.scene.poses import Standing
from fvs_engine.scene.sparse_points import PointCloud
from fvs_engine.sfm.growing import GrowingReconstruction
from fvs_engine.sfm.reconstruction import PosedView
from fvs_engine.sfm.settings import SfmSettings


class SfmPoses:
    """A ``PoseSource`` that owns a growing reconstruction; its first frame is the model frame and stays."""

    def __init__(self, folder: Path, image_dir: Path, settings: SfmSettings, monitor: Monitor) -> None:
        self._growing = GrowingReconstruction.open(folder, image_dir, settings, monitor)

    def stand(self, visited: Sequence[str], monitor: Monitor) -> Standing:
        """See ``PoseSource``. Photographs that overlap nothing have no pose until the reconstruction grew."""
        report = self._growing.add(visited, monitor)
        reconstruction, among = self._growing.reconstruction, set(visited)
        return Standing(
            views=tuple(view for view in reconstruction.views if view.name in among),
            points=PointCloud(reconstruction.points, reconstruction.point_colors),
            generation=self._growing.generation,
            warnings=report.warnings,
        )

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, PosedView]:
        """See ``PoseSource``."""
        return self._growing.localise(names, monitor)
