"""The points of an image as the other images see them: its own observations must not vouch for its pose."""

from collections.abc import Sequence
from itertools import islice

import numpy as np
import pycolmap

from fvs_engine.sfm.native.known_points import camera_of
from fvs_engine.sfm.native.prior_pose import Array
from fvs_engine.sfm.native.thresholds import POSES

Matches = Sequence[tuple[int, int]]
"""Features of an image and the points that they show, by their ids."""

LIMITS = pycolmap.IncrementalMapperOptions()
"""COLMAP's limits of the error of an observation, and of the angle between the rays to a point."""


def hangs_on_few_points(model: pycolmap.Reconstruction, image: pycolmap.Image) -> bool:
    """Whether at least two other images see only few of an image's points: its pose may be wrong."""
    held = (
        None
        for point in image.points2D
        if point.has_point3D() and model.point3D(point.point3D_id).track.length() >= 3
    )
    return sum(1 for _ in islice(held, POSES.few_points)) < POSES.few_points


def observations(image: pycolmap.Image) -> Matches:
    """The features of an image that show a point of the model, and these points."""
    return [(feature, seen.point3D_id) for feature, seen in enumerate(image.points2D) if seen.has_point3D()]


class Rays:
    """Normalised image coordinates of observations, kept per image; NaN where a lens distorts too much."""

    def __init__(self, model: pycolmap.Reconstruction) -> None:
        self._model = model
        self._flat: dict[int, Array] = {}

    def triangulated(self, track: Sequence[pycolmap.TrackElement]) -> Array | None:
        """The point [3] nearest to the rays of a ``track``; None where they meet at too small an angle."""
        rows, directions = [], []
        for element in track:
            image = self._model.image(element.image_id)
            x, y = self._of(image)[element.point2D_idx]
            pose = image.cam_from_world().matrix()
            rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
            directions.append(np.array([x, y, 1.0]) @ pose[:, :3])
        if not np.isfinite(rows).all():
            return None
        units = np.stack(directions) / np.linalg.norm(directions, axis=1, keepdims=True)
        if (units @ units.T).min() > np.cos(np.radians(LIMITS.filter_min_tri_angle)):
            return None
        *xyz, scale = np.linalg.svd(np.stack(rows))[2][-1]
        return np.array(xyz) / scale if abs(scale) > 1e-12 else None

    def points_of_others(self, image: pycolmap.Image, matches: Matches) -> tuple[Array, Array]:
        """The points [N, 3] of ``matches`` that other images determine, and where ``image`` sees them.

        Without those that it sees where a lens distorts too much.
        """
        points, pixels = [], []
        has_ray = np.asarray(np.isfinite(self._of(image)).all(axis=1))
        for feature, point_id in matches:
            if not has_ray[feature]:
                continue
            track = self._model.point3D(point_id).track.elements
            others = [element for element in track if element.image_id != image.image_id]
            xyz = self.triangulated(others) if len(others) >= 2 else None
            if xyz is not None:
                points.append(xyz)
                pixels.append(image.point2D(feature).xy)
        return np.array(points).reshape(-1, 3), np.array(pixels).reshape(-1, 2)

    def _of(self, image: pycolmap.Image) -> Array:
        if image.image_id not in self._flat:
            pixels = np.array([point.xy for point in image.points2D])
            self._flat[image.image_id] = np.asarray(camera_of(image).cam_from_img(pixels))
        return self._flat[image.image_id]
