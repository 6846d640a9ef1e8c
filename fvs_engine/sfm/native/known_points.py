"""The points of a model with the features that observed them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.native.prior_pose import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Features:
    """SIFT features of one image: ``pixels`` [K, 2], ``axes`` [K, 2] and unit ``descriptors`` [K, 128].

    An axis points where the feature's orientation does, and is as long as its scale, in px.
    """

    pixels: Array
    axes: Array
    descriptors: NDArray[np.float32]

    @staticmethod
    def read(database: pycolmap.Database, image_id: int) -> "Features":
        """Read the features of an image."""
        # Columns: x, y, and the affine shape, of which the first column is the orientation.
        shapes = np.asarray(database.read_keypoints(image_id), dtype=np.float64).reshape(-1, 6)
        rows = np.asarray(database.read_descriptors(image_id).data, dtype=np.float32).reshape(-1, 128)
        lengths = np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-6)
        return Features(shapes[:, :2], shapes[:, [2, 4]], rows / lengths)


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Points ``xyz`` [P, 3] of a model, and their observations [O], ordered by point.

    Of each: the index of its ``point``, the ``image`` (its id), the ``feature``, the feature's descriptor,
    its axis as a vector [3] at the point, and the direction ``ray`` [3] in which that image sees the point.
    """

    xyz: Array
    point: Indices
    image: Indices
    feature: Indices
    descriptors: NDArray[np.float32]
    axes: Array
    rays: Array

    @staticmethod
    def read(
        model: pycolmap.Reconstruction, database: pycolmap.Database, images: Sequence[pycolmap.Image]
    ) -> "KnownPoints":
        """The points that these registered images see; their features are those in ``database``."""
        numbers, parts = [], []
        for image in images:
            seen = [
                (k, int(p.point3D_id)) for k, p in enumerate(image.points2D) if p.has_point3D()
            ]  # pycolmap has no array of them
            if seen:
                numbers.append(np.array([point for _, point in seen], dtype=np.int64))
                parts.append((image, np.array([k for k, _ in seen], dtype=np.int64)))
        if not parts:
            empty = np.zeros(0, dtype=np.int64)
            none = np.zeros((0, 3))
            return KnownPoints(none, empty, empty, empty, np.zeros((0, 128), np.float32), none, none)
        kept, point = np.unique(np.concatenate(numbers), return_inverse=True)
        xyz = np.stack([model.point3D(int(number)).xyz for number in kept])
        columns = []
        begun = 0
        for image, feature in parts:
            own = xyz[point[begun : begun + len(feature)]]
            begun += len(feature)
            known = Features.read(database, image.image_id)
            pose = image.cam_from_world()
            rotation = pose.rotation.matrix()
            rays = own - np.asarray(image.projection_center())
            depth = rays @ rotation[2]
            flat = known.axes[feature] * (depth / camera_of(image).mean_focal_length())[:, None]
            columns.append(
                (
                    np.full(len(feature), image.image_id, dtype=np.int64),
                    feature,
                    known.descriptors[feature],
                    flat @ rotation[:2],
                    rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12),
                )
            )
        image_ids, features, descriptors, axes, rays = (
            np.concatenate(column) for column in zip(*columns, strict=True)
        )
        order = np.argsort(point, kind="stable")
        return KnownPoints(
            xyz,
            point[order],
            image_ids[order],
            features[order],
            descriptors[order],
            axes[order],
            rays[order],
        )

    def seen_from(self, centre: Array, most: int, max_angle_deg: float) -> Indices:
        """Up to ``most`` observations of each point, from the directions nearest to that of ``centre``."""
        towards = self.xyz - centre
        towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        cosines = (self.rays * towards[self.point]).sum(axis=1)
        order = np.lexsort((-cosines, self.point))
        rank = np.arange(len(order)) - np.searchsorted(self.point, self.point[order])
        near = (rank < most) & (cosines[order] >= np.cos(np.radians(max_angle_deg)))
        return np.sort(order[near])


def points_seen(
    model: pycolmap.Reconstruction, image_id: int, pairs: Sequence[VerifiedPair]
) -> list[tuple[int, int]]:
    """The (feature, point) pairs of an image that its matches with registered images give, each once."""
    seen = set()
    for pair in pairs:
        other, column = (pair.second, 0) if pair.first == image_id else (pair.first, 1)
        points = model.image(other).points2D
        for match in pair.matches:
            point = points[int(match[1 - column])]
            if point.has_point3D():
                seen.add((int(match[column]), int(point.point3D_id)))
    return sorted(seen)


def camera_of(image: pycolmap.Image) -> pycolmap.Camera:
    """The camera of an image of a model."""
    assert image.camera is not None
    return image.camera
