"""The witness's matches, which no mapper uses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import VerifiedPair, read_keypoints, read_verified_pairs
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES


@dataclass(frozen=True, eq=False)
class WitnessMatches:
    """Verified ``pairs`` of images, and keypoints [K, 2] in px of the full-size images by image id."""

    pairs: Sequence[VerifiedPair]
    keypoints: Mapping[int, NDArray[np.float64]]

    @staticmethod
    def read(database: Path) -> "WitnessMatches":
        """All verified pairs of the witness's database."""
        pairs = read_verified_pairs(database, MIN_PAIR_MATCHES)
        ids = {image_id for pair in pairs for image_id in (pair.first, pair.second)}
        return WitnessMatches(pairs, read_keypoints(database, ids))
