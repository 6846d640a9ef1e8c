"""A reconstruction that photographs are added to, one by one or many at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.reconstruction import PosedView, Reconstruction
from fvs_engine.sfm.settings import SfmSettings


@dataclass(frozen=True)
class GrowthReport:
    """What one ``add`` changed."""

    registered: tuple[str, ...]
    """Images that got their camera now, those that had waited among them."""

    waiting: tuple[str, ...]
    """All images that have no camera yet."""

    refreshed: bool
    """Whether all cameras were adjusted or found anew, not only those near the new ones."""

    warnings: tuple[str, ...]
    seconds: dict[str, float]
    """Wall-clock time per stage, s."""


class GrowingReconstruction:
    """Structure from motion that owns a folder over time; its model frame stays where it is."""

    @classmethod
    def open(
        cls, folder: Path, image_dir: Path, settings: SfmSettings, monitor: Monitor
    ) -> "GrowingReconstruction":
        """Create the reconstruction that ``folder`` keeps, or go on with it."""
        raise NotImplementedError

    def add(self, names: Sequence[str], monitor: Monitor) -> GrowthReport:
        """Add photographs (posix paths in the image folder)."""
        raise NotImplementedError

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, PosedView]:
        """Cameras of other photographs in the standing model, which stays as it is; without the unplaceable."""
        raise NotImplementedError

    @property
    def reconstruction(self) -> Reconstruction:
        """The standing model, in the model frame; empty before the first model."""
        raise NotImplementedError

    @property
    def registered(self) -> tuple[str, ...]:
        """Names of the images that have a camera, in the order in which they got it."""
        raise NotImplementedError

    @property
    def waiting(self) -> tuple[str, ...]:
        """Names of the images that were added and have no camera yet, in the order of adding."""
        raise NotImplementedError

    @property
    def generation(self) -> int:
        """Grows with every committed change; 0 before the first."""
        raise NotImplementedError
