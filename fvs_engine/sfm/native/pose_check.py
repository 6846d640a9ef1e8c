"""Check of the pose estimated for one image: against its verified matches and its position prior."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import VerifiedPair, read_keypoints, read_verified_pairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs, explains
from fvs_engine.sfm.verification.positions import misplaced

Keypoints = Mapping[int, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class PoseCheck:
    """Verified pairs, keypoints by image id and position priors, none of which depends on the model.

    ``min_image_support``: share of an image's matches that its pose must explain.
    """

    pairs: Sequence[VerifiedPair]
    keypoints: Keypoints
    min_image_support: float
    priors: PosePriors

    @staticmethod
    def read(database: str, min_image_support: float, priors: PosePriors) -> "PoseCheck":
        """Read the pairs and keypoints of a database."""
        pairs = read_verified_pairs(Path(database), MIN_PAIR_MATCHES)
        ids = {image_id for pair in pairs for image_id in (pair.first, pair.second)}
        return PoseCheck(pairs, read_keypoints(Path(database), ids), min_image_support, priors)

    def contradiction(self, model: pycolmap.Reconstruction, image_id: int) -> str | None:
        """What contradicts the pose of an image in ``model``, None if nothing does."""
        own = [pair for pair in self.pairs if image_id in (pair.first, pair.second)]
        involved = {i for pair in own for i in (pair.first, pair.second)}
        checks = check_pairs(model, own, {i: self.keypoints[i] for i in involved}, relative_poses=False)
        matches = sum(check.matches for check in checks)
        supported = sum(check.supported for check in checks)
        if not any(explains(check) for check in checks) or supported < self.min_image_support * matches:
            return f"{supported} of its {matches} verified matches fit its estimated pose"
        registered = [image for image in model.images.values() if image.has_pose]
        centres = {image.name: np.asarray(image.projection_center()) for image in registered}
        distance = misplaced(self.priors, centres).get(model.image(image_id).name)
        return (
            None if distance is None else f"its estimated position is {distance:.3g} off its position prior"
        )

    def match_support(self, model: pycolmap.Reconstruction) -> float | None:
        """Share of the verified matches within ``model`` that its poses explain; None without matches."""
        checks = check_pairs(model, self.pairs, self.keypoints, relative_poses=False)
        matches = sum(check.matches for check in checks)
        return sum(check.supported for check in checks) / matches if matches > 0 else None
