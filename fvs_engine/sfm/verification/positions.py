"""Position priors: where images were taken, by GPS or a dataset. Repeated patterns do not affect them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama
from fvs_engine.sfm.colmap.database import gps_positions, image_ids

Array = NDArray[np.float64]

_MIN_SHARED = 6
"""Minimum number of positions: any three centres nearly always fit."""

_MIN_TRACK = 5.0
"""Minimum ratio of a track's width to the accuracy of its positions for them to be evidence."""

_MAX_SHARE = 0.1
"""How far a camera may be from its prior, in shares of its distance from the middle of the others."""

_NOISE = 4.0
"""Robust standard deviations of the positions within which no camera is misplaced."""

GPS_ACCURACY_M = 5.0
"""Accuracy of GPS without corrections under an open sky."""


@dataclass(frozen=True, eq=False)
class Positions:
    """``by_name`` maps image names to positions [3] in one frame and unit; ``accuracy`` is in that unit."""

    by_name: Mapping[str, Array] = field(default_factory=dict)
    accuracy: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """As a JSON document."""
        by_name = {name: position.tolist() for name, position in self.by_name.items()}
        return {"by_name": by_name, "accuracy": self.accuracy}

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> "Positions":
        """The inverse of ``to_json``."""
        by_name = {name: np.array(xyz, dtype=np.float64) for name, xyz in document["by_name"].items()}
        return Positions(by_name, float(document["accuracy"]))

    def misplaced(self, centres: Mapping[str, Array]) -> dict[str, float]:
        """Name → distance, in this unit, of camera centres that are far from their positions.

        The two are aligned robustly; up to half may be wrong. Far is more than a share of the distance from
        the middle of the others (at least their spread: the error of an alignment grows with distance),
        and more than the positions scatter.
        """
        shared = sorted(centres.keys() & self.by_name.keys())
        aligned = self._align(centres, shared, _MIN_SHARED)
        if aligned is None:
            return {}
        report, off, spread = aligned
        world = np.stack([self.by_name[name] for name in shared])
        reach = np.hypot(spread, np.linalg.norm(world - world[report.inliers].mean(axis=0), axis=1))
        noise = max(self.accuracy, 1.4826 * report.median)
        limit = np.maximum(_MAX_SHARE * reach, _NOISE * noise)
        return {name: float(off[k]) for k, name in enumerate(shared) if off[k] > limit[k]}

    def residual_share(self, centres: Mapping[str, Array]) -> float | None:
        """Median distance of aligned centres from these positions, in shares of their spread.

        None when there are too few, or they are not accurate enough for so small a track.
        """
        shared = sorted(centres.keys() & self.by_name.keys())
        aligned = self._align(centres, shared, _MIN_SHARED - 2)
        if aligned is None:
            return None
        _, off, spread = aligned
        return float(np.median(off) / spread)

    def _align(
        self, centres: Mapping[str, Array], shared: list[str], least: int
    ) -> tuple[AlignmentReport, Array, float] | None:
        """The alignment, each one's distance after it, and the spread of the positions that agree."""
        if len(shared) < least:
            return None
        model, world = (np.stack([points[name] for name in shared]) for points in (centres, self.by_name))
        try:
            report = robust_umeyama(model, world)
        except InvalidInputError:  # all coincide, or no three agree
            return None
        landed = world[report.inliers]
        spread = float(np.sqrt(((landed - landed.mean(axis=0)) ** 2).sum(axis=1).mean()))
        if spread < _MIN_TRACK * self.accuracy:
            return None
        return report, np.linalg.norm(report.transform.apply(model) - world, axis=1), spread


def positions_in_exif(database: Path) -> Positions:
    """The GPS positions in m that the images of a database have in their EXIF."""
    names = {number: name for name, number in image_ids(database).items()}
    fixes = gps_positions(database)
    return Positions({names[number]: fix for number, fix in fixes.items()}, GPS_ACCURACY_M)
