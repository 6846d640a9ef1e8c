"""Poses by structure from motion on the visited images only."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding


class SfmPoses:
    """A ``PoseSource`` that owns a growing reconstruction.

    ``priors`` are those of a dataset's images; other datasets have them with every update.
    """

    def __init__(
        self,
        folder: Path,
        dataset: Dataset,
        settings: SfmSettings,
        monitor: Monitor,
        priors: PosePriors | None = None,
    ) -> None:
        self._priors = priors
        self._image_dir = dataset.image_dir
        self._growing = GrowingReconstruction.open(
            folder, dataset.image_dir, settings, monitor, remove_missing=dataset.arriving
        )

    @property
    def model_dir(self) -> Path | None:
        """See ``PoseSource``."""
        return self._growing.model_dir

    @property
    def quarantined(self) -> Mapping[str, Finding]:
        """See ``PoseSource``."""
        return self._growing.quarantined

    @property
    def why_unregistered(self) -> Mapping[str, Finding]:
        """See ``PoseSource``."""
        return self._growing.why_unregistered

    def has(self, visited: Collection[str]) -> bool:
        """See ``PoseSource``."""
        present = {name for name in visited if (self._image_dir / name).is_file()}
        return set(self._growing.added) == present - self._growing.quarantined.keys()

    def acknowledge(self) -> None:
        """See ``PoseSource``."""
        self._growing.acknowledge()

    def release(self, names: Collection[str]) -> None:
        """See ``PoseSource``."""
        self._growing.remove(names)

    def update(
        self,
        visited: Sequence[str],
        known: Iterable[AnyView],
        monitor: Monitor,
        priors: PosePriors | None = None,
    ) -> PoseUpdate:
        """See ``PoseSource``."""
        self._growing.remove(set(self._growing.added).difference(visited))
        update = self._growing.add(visited, monitor, self._priors or priors, known)
        return replace(update, two_view_points=self._growing.two_view_points(monitor))

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """See ``PoseSource``."""
        return self._growing.localise(names, monitor, self._priors)
