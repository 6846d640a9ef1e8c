"""Poses by structure from motion on the visited photographs only."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.poses import Standing
from fvs_engine.scene.sparse_points import PointCloud
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.verification.positions import Positions
from fvs_engine.views import AnyView


class SfmPoses:
    """A ``PoseSource`` that owns a growing reconstruction; its first frame is the model frame and stays.

    Where the dataset says that a photograph was taken only serves to see whether the place found for it can
    be right: a vehicle knows where it flew, and repeated patterns mislead matches.
    """

    def __init__(self, folder: Path, dataset: Dataset, settings: SfmSettings, monitor: Monitor) -> None:
        self._dataset = dataset
        self._growing = GrowingReconstruction.open(folder, dataset.image_dir, settings, monitor)

    def stand(self, visited: Sequence[str], monitor: Monitor, positions: Positions | None = None) -> Standing:
        """See ``PoseSource``. Photographs that overlap nothing have no pose until the reconstruction grew."""
        report = self._growing.add(visited, monitor, self._positions(visited) or positions)
        reconstruction, among = self._growing.reconstruction, set(visited)
        return Standing(
            views=tuple(view for view in reconstruction.views if view.name in among),
            points=PointCloud(reconstruction.points, reconstruction.point_colors),
            generation=self._growing.generation,
            warnings=report.warnings,
        )

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """See ``PoseSource``."""
        known = (*self._growing.registered, *names)
        return self._growing.localise(names, monitor, self._positions(known))

    def _positions(self, names: Iterable[str]) -> Positions | None:
        """What the dataset says; nothing for photographs that arrive with nobody's poses."""
        by_name = self._dataset.by_name
        return Positions({name: by_name[name].centre for name in names}) if by_name else None
