"""Camera centres against their position priors, which repeated patterns do not affect."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry.alignment.positions import GPS_ACCURACY_M, MIN_POSITIONS, PositionFit, fit_positions
from fvs_engine.sfm.colmap.database import gps_positions, image_ids
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.thresholds import PRIORS
from fvs_schema.findings import Finding, FindingCode

Array = NDArray[np.float64]


def fit_priors(
    priors: PosePriors, centres: Mapping[str, Array], least: int = MIN_POSITIONS
) -> PositionFit | None:
    """Align the centres that have a position prior, in the order of names; see ``fit_positions``."""
    names = shared(priors, centres)
    if len(names) < least:
        return None
    model = np.stack([centres[name] for name in names])
    return fit_positions(model, priors.positions(names), priors.position_sigmas(names), least)


def misplaced(priors: PosePriors, centres: Mapping[str, Array]) -> dict[str, float]:
    """Name → distance, in the priors' unit, of camera centres that are far from their position priors."""
    fit = fit_priors(priors, centres)
    if fit is None:
        return {}
    return {name: float(fit.off[k]) for k, name in enumerate(shared(priors, centres)) if fit.misplaced[k]}


def informative(priors: PosePriors, centres: Mapping[str, Array]) -> bool:
    """Whether there are enough position priors of these centres, and accurate enough, to judge others by."""
    return fit_priors(priors, centres) is not None


def residual_share(priors: PosePriors, centres: Mapping[str, Array]) -> float | None:
    """Median distance of aligned centres from their position priors, in shares of the priors' spread.

    None when there are too few, or they are not accurate enough for so small a track.
    """
    fit = fit_priors(priors, centres, PRIORS.min_residual_positions)
    return None if fit is None else fit.residual_share


def contradict(priors: PosePriors, centres: Mapping[str, Array]) -> bool:
    """Whether these centres have enough accurate position priors, and hardly any of them fits."""
    fit = fit_priors(priors, centres, PRIORS.min_residual_positions)
    return fit is not None and fit.contradicts


def shared(priors: PosePriors, centres: Mapping[str, Array]) -> list[str]:
    """The images with both a centre and a position prior, sorted by name: the order of a ``PositionFit``."""
    return sorted(centres.keys() & priors.by_name.keys())


def usable_priors(given: PosePriors | None, database: Path) -> tuple[PosePriors, tuple[Finding, ...]]:
    """The priors ``given``, by default the positions in metadata, without frozen ones, and warnings.

    A frozen receiver repeats its last position exactly, which one with a fix never does.
    """
    priors = _priors_in_metadata(database) if given is None else given
    counts = Counter(prior.position for prior in priors.by_name.values())
    frozen = sum(count for count in counts.values() if count >= PRIORS.frozen)
    if frozen == 0:
        return priors, ()
    moving = {name: prior for name, prior in priors.by_name.items() if counts[prior.position] < PRIORS.frozen}
    warning = Finding.of(
        FindingCode.FROZEN_POSITIONS, frozen=frozen, of=len(priors.by_name), others=PRIORS.frozen - 1
    )
    return PosePriors(by_name=moving), (warning,)


def _priors_in_metadata(database: Path) -> PosePriors:
    names = {number: name for name, number in image_ids(database).items()}
    fixes = gps_positions(database)
    return PosePriors(
        by_name={names[number]: PosePrior.at(fix, GPS_ACCURACY_M) for number, fix in fixes.items()}
    )
