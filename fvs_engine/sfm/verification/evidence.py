"""Evidence for a model's poses from the two-view geometries, which do not depend on the model.

A mapper minimises the error of the matches that it kept; it reports a good fit even after discarding those
that contradict it. So every verified match of every pair is checked again here.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import camera_centres
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.verification.conflicting_views import conflicting_views
from fvs_engine.sfm.verification.links import Links
from fvs_engine.sfm.verification.pair_check import PairCheck, angle_deg, check_pairs
from fvs_engine.sfm.verification.positions import misplaced, residual_share
from fvs_engine.sfm.verification.prior_support import prior_support
from fvs_engine.sfm.verification.scale import Scale, depth_ratios
from fvs_engine.sfm.verification.thresholds import PAIRS, PRIORS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ModelEvidence:
    """Evidence inputs for any model: verified pairs, keypoints [K, 2] in px by image id, position priors.

    ``focal_priors`` are the focal lengths in px that EXIF or the user gave, by camera id.
    """

    pairs: Sequence[VerifiedPair]
    keypoints: Mapping[int, Array]
    priors: PosePriors
    focal_priors: Mapping[int, float] = field(default_factory=dict)

    def of(self, model: pycolmap.Reconstruction, monitor: Monitor) -> Evidence | None:
        """The evidence for ``model``; None when no verified pair lies within it. It takes 10 ms per pair."""
        pairs, keypoints, priors = self.pairs, self.keypoints, self.priors
        checks = check_pairs(model, pairs, keypoints, on_pair=monitor.check)
        if not checks:
            return None
        posed = [image for image in model.images.values() if image.has_pose]
        centres = camera_centres(model)
        links = Links.of(model, checks)
        names = {image.image_id: image.name for image in posed}
        scale = Scale.of(names, depth_ratios(model, pairs, keypoints))
        return Evidence(
            pairs=len(checks),
            matches=sum(check.matches for check in checks),
            match_support=_match_support(checks),
            rotation_support=_rotation_support(checks),
            translation_support=_translation_support(checks),
            cycle_consistency=cycle_consistency(checks),
            unsupported_images=tuple(sorted(links.contradicted | links.unconnected)),
            loosely_linked_images=tuple(sorted(links.loose)),
            misscaled_images=tuple(sorted(scale.contradicted)),
            unscaled_images=tuple(sorted(scale.open)),
            conflicting_views=conflicting_views(model, pairs, keypoints, monitor.check),
            unlikely_focal_lengths_px=unlikely_focal_lengths(model, self.focal_priors),
            misplaced_images=tuple(sorted(misplaced(priors, centres))),
            images_without_prior=tuple(sorted(centres.keys() - priors.by_name.keys()))
            if priors.by_name
            else (),
            prior_residual_share=residual_share(priors, centres),
            prior_support=prior_support(
                checks,
                names,
                {image.image_id: image.cam_from_world().rotation.matrix().T for image in posed},
                priors,
            ),
        )

    def matches_explained(self, model: pycolmap.Reconstruction, names: Set[str]) -> int:
        """Number of the verified matches between the images ``names`` that fit their poses in ``model``."""
        ids = {image_id for image_id, image in model.images.items() if image.name in names}
        pairs = [pair for pair in self.pairs if pair.first in ids and pair.second in ids]
        checks = check_pairs(model, pairs, self.keypoints, relative_poses=False)
        return sum(check.supported for check in checks)


def unlikely_focal_lengths(model: pycolmap.Reconstruction, priors: Mapping[int, float]) -> tuple[float, ...]:
    """The focal lengths in px that are unlikely, sorted; ``priors`` are focal lengths in px by camera id.

    They are refined with the model, and some scenes do not determine them: a wall seen head-on, a few images
    that hardly overlap. Every match still fits such a model, whose depths are wrong.
    Without a prior, a focal length is compared with those of usual lenses.
    """
    cameras = {image.camera_id for image in model.images.values() if image.has_pose}
    return tuple(
        sorted(focal for focal in (_unlikely(model.cameras[i], priors.get(i)) for i in cameras) if focal)
    )


def _unlikely(camera: pycolmap.Camera, prior: float | None) -> float | None:
    """The camera's focal length when it is unlikely."""
    focal = float(camera.mean_focal_length())
    least, most = (
        (share * max(camera.width, camera.height) for share in PRIORS.focal_shares)
        if prior is None
        else (prior / PRIORS.max_focal_change, prior * PRIORS.max_focal_change)
    )
    return None if least <= focal <= most else focal


def cycle_consistency(checks: Sequence[PairCheck]) -> float | None:
    """Share of the triplets whose three relative rotations close within 5°; None without triplets."""
    rotations: dict[int, dict[int, Array]] = {}
    for check in checks:
        if check.second_from_first is not None:
            rotations.setdefault(check.first, {})[check.second] = check.second_from_first.rotation
    closed = total = 0
    for ahead in rotations.values():
        for b, b_from_a in ahead.items():
            for c, c_from_b in rotations.get(b, {}).items():
                if c in ahead:
                    total += 1
                    closed += angle_deg(ahead[c].T @ c_from_b @ b_from_a) < PAIRS.max_rotation_deg
                    if total == PAIRS.max_triplets:
                        return closed / total
    return closed / total if total > 0 else None


def _match_support(checks: Sequence[PairCheck]) -> float:
    return sum(check.supported for check in checks) / sum(check.matches for check in checks)


def _rotation_support(checks: Sequence[PairCheck]) -> float | None:
    return _weighted_share([check.rotation_error_deg for check in checks], PAIRS.max_rotation_deg, checks)


def _translation_support(checks: Sequence[PairCheck]) -> float | None:
    return _weighted_share([check.direction_error_deg for check in checks], PAIRS.max_direction_deg, checks)


def _weighted_share(
    angles_deg: Sequence[float], limit_deg: float, checks: Sequence[PairCheck]
) -> float | None:
    errors_deg, weights = (
        np.array(angles_deg),
        np.array([check.matches for check in checks], dtype=np.float64),
    )
    known = np.isfinite(errors_deg)
    if not known.any():
        return None
    return float((weights[known] * (errors_deg[known] < limit_deg)).sum() / weights[known].sum())
