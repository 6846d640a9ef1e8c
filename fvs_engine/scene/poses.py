"""Where a scene's cameras and points come from: the dataset, or structure from motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from fvs_engine.monitor import Monitor
from fvs_engine.scene.sparse_points import PointCloud
from fvs_engine.sfm.verification.positions import Positions
from fvs_engine.views import AnyView


@dataclass(frozen=True, eq=False)
class Standing:
    """What is known of the visited views at one moment, in the model frame.

    ``views`` are those that have a pose, in no particular order; ``points`` were seen by at least two visited
    views. ``generation`` is the source's own count of its changes.
    """

    views: tuple[AnyView, ...]
    points: PointCloud
    generation: int
    warnings: tuple[str, ...] = ()


class PoseSource(Protocol):
    """Poses of the visited views. What it keeps on disk is its own affair; it survives a kill."""

    def stand(self, visited: Sequence[str], monitor: Monitor, positions: Positions | None = None) -> Standing:
        """Learn of the photographs ``visited`` that are new, and say where all of them stand.

        Asking the same again, after a kill, gives the same answer. It learns of no other photographs.
        ``positions``: where photographs without poses in the dataset were taken, if somebody told.
        """
        ...

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """Poses in the model frame of views that are not part of it, without those that cannot be placed."""
        ...
