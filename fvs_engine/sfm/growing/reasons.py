"""Why images of a growing reconstruction have no pose, or a doubtful one."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import feature_counts, verified_matches
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.sfm.verification.positions import fit_priors, shared, usable_priors
from fvs_schema.findings import Finding, FindingCode, Severity


def why_unregistered(state: GrowthState, database: Path) -> Mapping[str, Finding]:
    """Unregistered images → the reason, by the last try; ``database`` has features and matches."""
    unregistered = [name for name in state.unregistered if name not in state.pending]
    if not unregistered:
        return {}
    features = feature_counts(database)
    matched = {name for pair in verified_matches(database, MIN_PAIR_MATCHES) for name in pair}
    reasons = {}
    for name in unregistered:
        if name in state.rejected:
            reasons[name] = state.rejected[name]
        elif not features.get(name):
            reasons[name] = Finding.of(FindingCode.NO_FEATURES, [name])
        else:
            code = FindingCode.FEW_POINTS if name in matched else FindingCode.UNMATCHED
            reasons[name] = Finding.of(code, [name])
    return reasons


def doubts_by_priors(
    given: PosePriors | None, database: Path, centres: Mapping[str, NDArray[np.float64]]
) -> tuple[Finding, ...]:
    """The finding that names registered images whose poses contradict their position priors.

    New poses are checked when they are estimated. Priors may be able to judge them only later, when the track
    has become long enough for their accuracy. No warning where model and priors contradict each other as a
    whole.

    ``given``: pose priors, by default the positions in metadata that the ``database`` has.
    """
    if not centres:
        return ()
    priors, _ = usable_priors(given, database)
    fit = fit_priors(priors, centres)
    if fit is None or fit.contradicts or not fit.misplaced.any():
        return ()
    names = [name for name, far in zip(shared(priors, centres), fit.misplaced, strict=True) if far]
    return (Finding.of(FindingCode.FAR_FROM_PRIORS, names, Severity.DOUBT, of=len(centres)),)
