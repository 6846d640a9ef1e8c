"""Reach: the views that the camera can fly to next, within a radius of its centre or the nearest few."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError

Array = NDArray[np.float64]

SPACINGS = 8.0
"""The default radius in median distances between consecutive views.

The paper gives no number, only that the vehicle's range per step bounds it. The default is relative to the
capture's spacing: a step can skip the next few views of a dense capture, but not cross the scene. On
Mip-NeRF360 *bonsai* (0.27 units from view to view, 4.8 from the middle to the outermost) walks of random
steps from the first ten views to one hundred got stuck half of the time with 5 spacings, never with 8."""


@dataclass(frozen=True)
class Reach:
    """Views within ``radius`` of the camera, or a number of ``nearest`` ones; exactly one is given."""

    radius: float | None = None
    nearest: int | None = None

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.nearest is None):
            raise InvalidInputError("Reach is a radius or a number of nearest views, exactly one of the two.")

    def reaches_all(self, count: int) -> bool:
        """Whether ``count`` views are always in reach, wherever they are."""
        return self.nearest is not None and self.nearest >= count

    def scaled(self, scale: float) -> "Reach":
        """The same reach where lengths are ``scale`` times as large."""
        return self if self.radius is None else Reach(radius=self.radius * scale)

    def distances(self, here: Array, centres: Mapping[str, Array]) -> dict[str, float]:
        """The views in reach of ``here`` [3], the nearest first, with their distances; ties by name."""
        if not centres:
            return {}
        lengths = np.linalg.norm(np.stack(list(centres.values())) - here, axis=1).tolist()
        by_distance = sorted(zip(lengths, centres, strict=True))
        if self.radius is not None:
            return {name: distance for distance, name in by_distance if distance <= self.radius}
        return {name: distance for distance, name in by_distance[: self.nearest]}


def default_radius(centres: Array) -> float:
    """``SPACINGS`` times the median distance between consecutive centres [N, 3] of a capture.

    Views taken from one spot do not count as spaced. Raises ``InvalidInputError`` when all were.
    """
    spacings = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    # The centres of a camera at rest differ by rounding.
    moved = spacings[spacings > 1e-9 * max(1.0, float(np.abs(centres).max(initial=0.0)))]
    if len(moved) == 0:
        raise InvalidInputError(
            "All views of the dataset have the same position, so no radius can be derived.",
            hint="Choose among a number of nearest views instead (--nearest).",
        )
    return SPACINGS * float(np.median(moved))


def rounded_up(distance: float) -> float:
    """Rounded up to four digits, so that a printed length is enough."""
    if distance == 0:
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(distance)) - 3)
    return float(np.ceil(distance / unit) * unit)
