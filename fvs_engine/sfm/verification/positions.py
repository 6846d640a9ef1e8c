"""Camera centres against their position priors, which repeated patterns do not affect."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama, umeyama
from fvs_engine.sfm.colmap.database import gps_positions, image_ids
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors

Array = NDArray[np.float64]

_MIN_SHARED = 6
"""Minimum number of positions: any three centres nearly always fit."""

_MIN_TRACK = 5.0
"""Minimum ratio of a track's width to the accuracy of its positions for them to be evidence."""

_MAX_SHARE = 0.1
"""Maximum distance of a camera from its prior, in shares of its distance from the middle of the others."""

MAX_MISPLACED_SHARE = 1.0 / 3.0
"""Share of the images that may be far from their position priors before model and priors contradict."""

_MAX_RESIDUAL_SHARE = 0.25
"""Median distance from the priors, in shares of their spread, from which on model and priors contradict."""

_FROZEN = 3
"""Number of images with exactly the same position from which on the receiver counts as frozen."""

_NOISE = 4.0
"""Standard deviations of the positions within which no camera is misplaced."""

GPS_ACCURACY_M = 5.0
"""Accuracy of GPS without corrections under an open sky."""


def misplaced(priors: PosePriors, centres: Mapping[str, Array]) -> dict[str, float]:
    """Name → distance, in the priors' unit, of camera centres that are far from their position priors.

    The two are aligned robustly; up to half may be wrong. Far is more than a share of the distance from the
    middle of the others (at least their spread: the error of an alignment grows with distance), and more than
    the positions scatter. None is where one alignment fits all: that of cameras side by side, by noisy
    positions, is far off at others.
    """
    shared = sorted(centres.keys() & priors.by_name.keys())
    aligned = align_positions(priors, centres, shared, _MIN_SHARED)
    if aligned is None or _all_fit(priors, centres, shared):
        return {}
    report, off, spread = aligned
    world = priors.positions(shared)
    reach = np.hypot(spread, np.linalg.norm(world - world[report.inliers].mean(axis=0), axis=1))
    noise = np.maximum(priors.position_sigmas(shared), 1.4826 * report.median)
    limit = np.maximum(_MAX_SHARE * reach, _NOISE * noise)
    return {name: float(off[k]) for k, name in enumerate(shared) if off[k] > limit[k]}


def _all_fit(priors: PosePriors, centres: Mapping[str, Array], shared: list[str]) -> bool:
    """Whether one alignment brings all centres as near to their priors as these are accurate."""
    model, world = np.stack([centres[name] for name in shared]), priors.positions(shared)
    off = np.linalg.norm(umeyama(model, world).apply(model) - world, axis=1)
    return bool((off <= _NOISE * priors.position_sigmas(shared)).all())


def informative(priors: PosePriors, centres: Mapping[str, Array]) -> bool:
    """Whether there are enough position priors of these centres, and accurate enough, to judge others by."""
    return align_positions(priors, centres, sorted(centres.keys() & priors.by_name.keys())) is not None


def residual_share(priors: PosePriors, centres: Mapping[str, Array]) -> float | None:
    """Median distance of aligned centres from their position priors, in shares of the priors' spread.

    None when there are too few, or they are not accurate enough for so small a track.
    """
    shared = sorted(centres.keys() & priors.by_name.keys())
    aligned = align_positions(priors, centres, shared, _MIN_SHARED - 2)
    if aligned is None:
        return None
    _, off, spread = aligned
    return float(np.median(off) / spread)


def contradict(priors: PosePriors, centres: Mapping[str, Array]) -> bool:
    """Whether these centres have enough accurate position priors, and hardly any of them fits."""
    share = residual_share(priors, centres)
    count = len(centres.keys() & priors.by_name.keys())
    return share is not None and (
        share > _MAX_RESIDUAL_SHARE or len(misplaced(priors, centres)) > MAX_MISPLACED_SHARE * count
    )


def align_positions(
    priors: PosePriors, centres: Mapping[str, Array], shared: list[str], least: int = _MIN_SHARED
) -> tuple[AlignmentReport, Array, float] | None:
    """The alignment of the ``shared`` centres, each one's distance after it, and the agreeing ones' spread.

    None when there are fewer than ``least``, or they do not determine it.
    """
    if len(shared) < least:
        return None
    model, world = np.stack([centres[name] for name in shared]), priors.positions(shared)
    try:
        report = robust_umeyama(model, world)
    except InvalidInputError:  # all coincide, or no three agree
        return None
    spread = centre_spread(world[report.inliers])
    if spread < _MIN_TRACK * float(np.median(priors.position_sigmas(shared))):
        return None
    return report, np.linalg.norm(report.transform.apply(model) - world, axis=1), spread


def usable_priors(given: PosePriors | None, database: Path) -> tuple[PosePriors, tuple[str, ...]]:
    """The priors ``given``, by default the GPS positions in EXIF, without frozen ones, and warnings.

    A frozen receiver repeats its last position exactly, which one with a fix never does.
    """
    priors = _priors_in_exif(database) if given is None else given
    counts = Counter(prior.position for prior in priors.by_name.values())
    frozen = sum(count for count in counts.values() if count >= _FROZEN)
    if frozen == 0:
        return priors, ()
    moving = {name: prior for name, prior in priors.by_name.items() if counts[prior.position] < _FROZEN}
    warning = (
        f"{frozen} of {len(priors.by_name)} images have the same position as {_FROZEN - 1} others or more: "
        "the receiver froze. These positions are not used."
    )
    return PosePriors(by_name=moving), (warning,)


def _priors_in_exif(database: Path) -> PosePriors:
    names = {number: name for name, number in image_ids(database).items()}
    fixes = gps_positions(database)
    return PosePriors(
        by_name={names[number]: PosePrior.at(fix, GPS_ACCURACY_M) for number, fix in fixes.items()}
    )
