"""Camera centres compared with their positions from another source, such as GPS."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama, umeyama

Array = NDArray[np.float64]

GPS_ACCURACY_M = 5.0
"""Accuracy of GPS without corrections under an open sky."""

MIN_POSITIONS = 6
"""Minimum number of positions: any three centres nearly always fit."""

MAX_MISPLACED_SHARE = 1.0 / 3.0
"""Share of the images that may be far from their positions before model and positions contradict."""

_MIN_TRACK = 5.0
"""Minimum ratio of a track's width to the accuracy of its positions for them to be evidence."""

_MAX_SHARE = 0.1
"""Maximum distance of a camera from its position, in shares of its distance from the middle of the others."""

_MAX_RESIDUAL_SHARE = 0.25
"""Median distance from the positions, in shares of their spread, from which on model and positions
contradict."""

_NOISE = 4.0
"""Standard deviations of the positions within which no camera is misplaced."""


@dataclass(frozen=True, eq=False)
class PositionFit:
    """A robust alignment of N centres with their positions, of which up to half may be wrong.

    ``off`` [N]: each one's distance after it. ``spread``: that of the positions that agree. ``misplaced``
    [N]: which centres are far from their positions. Far is more than a share of the distance from the middle
    of the others (at least their spread: the error of an alignment grows with distance), and more than the
    positions scatter. None is where one alignment fits all: that of cameras side by side, by noisy
    positions, is far off at others. Nor is one of fewer than ``MIN_POSITIONS``.
    """

    report: AlignmentReport
    off: Array
    spread: float
    misplaced: NDArray[np.bool_]

    @property
    def residual_share(self) -> float:
        """The median distance from the positions, in shares of their spread."""
        return float(np.median(self.off) / self.spread)

    @property
    def contradicts(self) -> bool:
        """Whether centres and positions contradict each other as a whole."""
        many = self.misplaced.sum() > MAX_MISPLACED_SHARE * len(self.misplaced)
        return self.residual_share > _MAX_RESIDUAL_SHARE or bool(many)


def fit_positions(
    centres: Array, positions: Array, sigmas: Array, least: int = MIN_POSITIONS
) -> PositionFit | None:
    """Align ``centres`` [N, 3] with ``positions`` [N, 3], whose standard deviations are ``sigmas`` [N].

    None when there are fewer than ``least``, they do not determine an alignment, or the track is too small
    for so inaccurate ones.
    """
    if len(centres) < least:
        return None
    try:
        report = robust_umeyama(centres, positions)
    except InvalidInputError:  # all coincide, or no three agree
        return None
    spread = centre_spread(positions[report.inliers])
    if spread < _MIN_TRACK * float(np.median(sigmas)):
        return None
    off = np.linalg.norm(report.transform.apply(centres) - positions, axis=1)
    misplaced = np.zeros(len(centres), dtype=bool)
    if len(centres) >= MIN_POSITIONS and not _all_fit(centres, positions, sigmas):
        middle = positions[report.inliers].mean(axis=0)
        reach = np.hypot(spread, np.linalg.norm(positions - middle, axis=1))
        noise = np.maximum(sigmas, 1.4826 * report.median)
        misplaced = off > np.maximum(_MAX_SHARE * reach, _NOISE * noise)
    return PositionFit(report, off, spread, misplaced)


def _all_fit(centres: Array, positions: Array, sigmas: Array) -> bool:
    """Whether one alignment brings all centres as near to their positions as these are accurate."""
    off = np.linalg.norm(umeyama(centres, positions).apply(centres) - positions, axis=1)
    return bool((off <= _NOISE * sigmas).all())
