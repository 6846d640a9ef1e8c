"""Why images of a growing reconstruction have no pose."""

from collections.abc import Mapping
from pathlib import Path

from fvs_engine.sfm.colmap.database import feature_counts, verified_matches
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES

NO_FEATURES = "It has no features: it is blurred, too dark, or shows nothing with structure."
UNMATCHED = "It matches no other image."
FEW_POINTS = "Too few of its matches are of points in the model."


def why_unregistered(state: GrowthState, database: Path) -> Mapping[str, str]:
    """Unregistered images → a sentence each, by the last try; ``database`` has features and matches."""
    unregistered = [name for name in state.unregistered if name not in state.pending]
    if not unregistered:
        return {}
    features = feature_counts(database)
    matched = {name for pair in verified_matches(database, MIN_PAIR_MATCHES) for name in pair}
    reasons = {}
    for name in unregistered:
        if name in state.rejected:
            reasons[name] = f"Its pose was rejected: {state.rejected[name]}."
        elif not features.get(name):
            reasons[name] = NO_FEATURES
        else:
            reasons[name] = FEW_POINTS if name in matched else UNMATCHED
    return reasons
