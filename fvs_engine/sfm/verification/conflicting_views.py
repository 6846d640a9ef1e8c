"""Pairs of images that should show the same, and do not: two places that look alike, taken for one.

Equal walls match as one wall does, and all matches fit a model in which they coincide. What is beside the
walls differs: there one image has features, and none of them is a point that the other one shows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.cameras import Camera
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import camera_from_pycolmap, rigid_from_pycolmap
from fvs_engine.sfm.verification.thresholds import CONFLICTS

Array = NDArray[np.float64]
Cells = NDArray[np.int64]


def conflicting_views(
    model: pycolmap.Reconstruction,
    pairs: Sequence[VerifiedPair],
    keypoints: Mapping[int, Array],
    on_pair: Callable[[], None] | None = None,
) -> tuple[tuple[str, str], ...]:
    """The names of the images of those ``pairs`` that conflict in ``model``.

    ``keypoints`` [K, 2] are those of each image in px. ``on_pair`` is called before each pair is compared and
    may raise to stop.
    """
    views: dict[int, _View | None] = {}
    found = []
    for pair in pairs:
        ids = pair.first, pair.second
        if not all(model.exists_image(i) and model.image(i).has_pose for i in ids):
            continue
        if len(pair.matches) < CONFLICTS.min_matched_share * min(len(keypoints[i]) for i in ids):
            continue
        if on_pair is not None:
            on_pair()
        for i in ids:
            if i not in views:
                views[i] = _View.of(model, model.image(i), keypoints[i])
        first, second = (views[i] for i in ids)
        if first and second and (first.lacks(second) or second.lacks(first)):
            found.append((model.image(pair.first).name, model.image(pair.second).name))
    return tuple(sorted(found))


@dataclass(frozen=True, eq=False)
class _View:
    """A registered image: its points by their ids [P] and positions [P, 3], and its features per cell."""

    camera: Camera
    camera_from_model: RigidTransform
    centre: Array
    ids: NDArray[np.int64]
    xyz: Array
    features: Cells

    @staticmethod
    def of(model: pycolmap.Reconstruction, image: pycolmap.Image, keypoints: Array) -> "_View | None":
        """None for a camera that no lens has: points have no certain place in its images."""
        try:
            camera = camera_from_pycolmap(model.camera(image.camera_id))
        except InvalidInputError:
            return None
        seen = [point.point3D_id for point in image.points2D if point.has_point3D()]
        pose = rigid_from_pycolmap(image.cam_from_world())
        return _View(
            camera,
            pose,
            pose.inverse().translation,
            np.array(seen, dtype=np.int64),
            np.array([model.point3D(point_id).xyz for point_id in seen]).reshape(-1, 3),
            _per_cell(keypoints, camera),
        )

    def lacks(self, other: "_View") -> bool:
        """Whether many cells of this image show nothing of the other image although they should."""
        local = self.camera_from_model.apply(other.xyz)
        to_own, to_other = self.centre - other.xyz, other.centre - other.xyz
        own, others = np.linalg.norm(to_own, axis=1), np.linalg.norm(to_other, axis=1)
        near = (to_own * to_other).sum(axis=1) >= np.cos(np.radians(CONFLICTS.max_angle_deg)) * own * others
        near &= np.maximum(own, others) <= CONFLICTS.max_distance_ratio * np.minimum(own, others)
        pixels = np.nan_to_num(self.camera.project(local[near]), nan=-1.0)
        inside = ((pixels >= 0) & (pixels < (self.camera.width, self.camera.height))).all(axis=1)
        expected = _per_cell(pixels[inside], self.camera)
        both = np.isin(other.ids[near][inside], self.ids)
        shown = _per_cell(pixels[inside][both], self.camera) > 0
        needed = expected >= CONFLICTS.min_points
        missing = needed & ~shown & (self.features >= CONFLICTS.min_features)
        count = int(missing.sum())
        return count >= CONFLICTS.min_cells and count >= CONFLICTS.min_share * (
            count + int((needed & shown).sum())
        )


def _per_cell(pixels: Array, camera: Camera) -> Cells:
    """How many ``pixels`` [N, 2] are in each cell [64] of an image."""
    columns, rows = np.clip(
        np.floor(pixels / (camera.width, camera.height) * CONFLICTS.cells), 0, CONFLICTS.cells - 1
    ).T
    return np.bincount((columns * CONFLICTS.cells + rows).astype(np.int64), minlength=CONFLICTS.cells**2)
