"""Doubts about registered images whose poses contradict their position priors.

New poses are checked when they are estimated. Priors may be able to judge them only later, when the track has
become long enough for their accuracy.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.images.names import listed
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.positions import fit_priors, shared, usable_priors
from fvs_engine.sfm.warnings import doubtful


def doubts_by_priors(
    given: PosePriors | None, database: Path, centres: Mapping[str, NDArray[np.float64]]
) -> tuple[str, ...]:
    """The warning that names these images; none where model and priors contradict each other as a whole.

    ``given``: pose priors, by default the GPS positions in the EXIF data that the ``database`` has.
    """
    if not centres:
        return ()
    priors, _ = usable_priors(given, database)
    fit = fit_priors(priors, centres)
    if fit is None or fit.contradicts or not fit.misplaced.any():
        return ()
    names = listed([name for name, far in zip(shared(priors, centres), fit.misplaced, strict=True) if far])
    return (
        doubtful(
            f"Far from their position priors: {names}. Either their poses or these positions are wrong."
        ),
    )
