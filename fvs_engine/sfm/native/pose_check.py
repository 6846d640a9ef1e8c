"""Check of the pose estimated for one image: against its verified matches and its prior."""

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import VerifiedPair, read_keypoints, read_verified_pairs
from fvs_engine.sfm.colmap.model import camera_centres
from fvs_engine.sfm.native.thresholds import POSES
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.conflicting_views import conflicting_views
from fvs_engine.sfm.verification.links import Links
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, PairCheck, check_pairs, explains
from fvs_engine.sfm.verification.positions import misplaced
from fvs_engine.sfm.verification.scale import Scale, depth_ratios
from fvs_schema.findings import Finding, FindingCode

Keypoints = Mapping[int, NDArray[np.float64]]

_Camera = tuple[int, bytes, bytes]
"""An image's id, pose and intrinsics."""


@dataclass(frozen=True, eq=False)
class PoseCheck:
    """Checks poses by verified pairs, keypoints (by image id) and position priors, which no model changes.

    ``min_image_support``: minimum share of an image's matches that its pose explains.
    """

    pairs: Sequence[VerifiedPair]
    keypoints: Keypoints
    min_image_support: float
    priors: PosePriors
    _scales: dict[tuple[_Camera, ...], Scale] = field(default_factory=dict)
    """The cameras of the last check of depths → its result: a pose is often checked twice."""

    @staticmethod
    def read(
        database: Path,
        min_image_support: float,
        priors: PosePriors,
        around: Collection[str] | None = None,
    ) -> "PoseCheck":
        """Read the pairs and keypoints of a database.

        ``around``: the images whose poses will be checked; only their pairs, and those of images that match
        them, are read.
        """
        pairs = read_verified_pairs(database, MIN_PAIR_MATCHES, around)
        ids = {image_id for pair in pairs for image_id in (pair.first, pair.second)}
        return PoseCheck(pairs, read_keypoints(database, ids), min_image_support, priors)

    def contradiction(self, model: pycolmap.Reconstruction, image_id: int) -> Finding | None:
        """What contradicts the pose of an image in ``model``, None if nothing does."""
        name = model.image(image_id).name
        checks = _checks_of(image_id, model, self.pairs, self.keypoints)
        matches = sum(check.matches for check in checks)
        supported = sum(check.supported for check in checks)
        if not any(explains(check) for check in checks) or supported < self.min_image_support * matches:
            return Finding.of(FindingCode.POSE_UNSUPPORTED, [name], supported=supported, matches=matches)
        if name in self._scale(model, {image_id}).contradicted:
            return Finding.of(FindingCode.POSE_AT_WRONG_DISTANCE, [name])
        distance = misplaced(self.priors, camera_centres(model)).get(name)
        if distance is None:
            return None
        return Finding.of(FindingCode.POSE_FAR_FROM_PRIOR, [name], distance=distance)

    def match_support(self, model: pycolmap.Reconstruction) -> float | None:
        """Share of the verified matches within ``model`` that its poses explain; None without matches."""
        checks = check_pairs(model, self.pairs, self.keypoints, relative_poses=False)
        matches = sum(check.matches for check in checks)
        return sum(check.supported for check in checks) / matches if matches > 0 else None

    def loosely_linked(self, model: pycolmap.Reconstruction) -> frozenset[str]:
        """The images that only pairs of few matches connect with the rest."""
        return Links.of(model, check_pairs(model, self.pairs, self.keypoints, relative_poses=False)).loose

    def unscaled(self, model: pycolmap.Reconstruction, names: Sequence[str]) -> list[str]:
        """Those of the registered images ``names`` whose distance to their neighbours nothing confirms."""
        ids = {i for i, image in model.images.items() if image.has_pose and image.name in set(names)}
        scale = self._scale(model, ids)
        return [name for name in names if name in scale.open]

    def conflicting(self, model: pycolmap.Reconstruction, names: Sequence[str]) -> list[tuple[str, str]]:
        """The pairs with one of the registered images ``names`` that should show the same, and do not."""
        ids = {i for i, image in model.images.items() if image.name in set(names)}
        own = [pair for pair in self.pairs if not ids.isdisjoint((pair.first, pair.second))]
        return list(conflicting_views(model, own, self.keypoints))

    def _scale(self, model: pycolmap.Reconstruction, ids: Set[int]) -> Scale:
        """The depth check of the images ``ids`` and those that match them best."""
        near = set(ids)
        for i in ids:
            own = [pair for pair in self.pairs if i in (pair.first, pair.second)]
            for pair in sorted(own, key=lambda pair: -len(pair.matches))[: POSES.max_near]:
                near |= {pair.first, pair.second}
        inside = [pair for pair in self.pairs if pair.first in near and pair.second in near]
        posed = {i: image for i, image in model.images.items() if i in near and image.has_pose}
        cameras = tuple(
            (i, image.cam_from_world().matrix().tobytes(), image.camera.params.tobytes())
            for i, image in posed.items()
        )
        if self._scales.get(cameras) is None:
            names = {i: image.name for i, image in posed.items()}
            self._scales.clear()
            self._scales[cameras] = Scale.of(names, depth_ratios(model, inside, self.keypoints))
        return self._scales[cameras]


def _checks_of(
    image_id: int, model: pycolmap.Reconstruction, pairs: Sequence[VerifiedPair], keypoints: Keypoints
) -> list[PairCheck]:
    """The pairs of one image against a model."""
    own = [pair for pair in pairs if image_id in (pair.first, pair.second)]
    involved = {i for pair in own for i in (pair.first, pair.second)}
    return check_pairs(model, own, {i: keypoints[i] for i in involved}, relative_poses=False)
