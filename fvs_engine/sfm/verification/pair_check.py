"""Verified pairs against a model's poses, which they do not depend on."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.verification.thresholds import PAIRS

Array = NDArray[np.float64]

MIN_PAIR_MATCHES = 15
"""COLMAP's own limit for a verified pair."""


@dataclass(frozen=True, eq=False)
class PairCheck:
    """One pair against a model; angles in degrees, NaN when there is nothing to compare.

    ``features`` is the geometric mean of the two images' numbers of keypoints. ``second_from_first`` is the
    relative pose (its translation has no scale) from the matches of the pair alone; None when they leave it
    open.
    """

    first: int
    second: int
    matches: int
    supported: int
    features: float
    rotation_error_deg: float
    direction_error_deg: float
    second_from_first: RigidTransform | None = None

    @property
    def baseline(self) -> Array | None:
        """The direction [3] in which the first camera sees the second, by ``second_from_first``."""
        if self.second_from_first is None:
            return None
        translation = self.second_from_first.inverse().translation
        return np.asarray(translation / np.linalg.norm(translation))


def check_pairs(
    model: pycolmap.Reconstruction,
    pairs: Sequence[VerifiedPair],
    keypoints: Mapping[int, Array],
    *,
    relative_poses: bool = True,
    on_pair: Callable[[], None] | None = None,
) -> list[PairCheck]:
    """Compare every pair whose images both have poses with the model.

    ``keypoints`` maps image ids to positions [K, 2] in px of the full-size images. Without ``relative_poses``
    only the matches are counted, which takes 1 % of the time. ``on_pair`` is called before each pair and may
    raise to stop.
    """
    posed = {i: image for i, image in model.images.items() if image.has_pose and i in keypoints}
    spread = centre_spread(
        np.array([image.projection_center() for image in model.images.values() if image.has_pose])
    )
    positions = normalised(model, keypoints)
    checks = []
    for pair in pairs:
        if on_pair is not None:
            on_pair()
        if pair.first not in posed or pair.second not in posed:
            continue
        first, second = posed[pair.first], posed[pair.second]
        estimated = relative_pose(pair, first.camera, second.camera, keypoints) if relative_poses else None
        relative = second.cam_from_world() * first.cam_from_world().inverse()
        rotation_error, direction_error = _relative_errors(
            estimated,
            relative.rotation.matrix(),
            np.asarray(relative.translation),
            PAIRS.min_baseline_share * spread,
        )
        checks.append(
            PairCheck(
                pair.first,
                pair.second,
                len(pair.matches),
                int(fitting(pair, first, second, positions).sum()),
                math.sqrt(len(positions[pair.first]) * len(positions[pair.second])),
                rotation_error,
                direction_error,
                estimated,
            )
        )
    return checks


def normalised(model: pycolmap.Reconstruction, keypoints: Mapping[int, Array]) -> dict[int, Array]:
    """The keypoints [K, 2] of the posed images in camera coordinates at depth 1, by image id."""
    return {
        i: np.asarray(image.camera.cam_from_img(keypoints[i]))
        for i, image in model.images.items()
        if image.has_pose and i in keypoints
    }


def fitting(
    pair: VerifiedPair, first: pycolmap.Image, second: pycolmap.Image, positions: Mapping[int, Array]
) -> NDArray[np.bool_]:
    """Which of the pair's matches [M] fit the poses of its two images; ``positions`` are ``normalised``."""
    relative = second.cam_from_world() * first.cam_from_world().inverse()
    return supported(
        positions[pair.first][pair.matches[:, 0]],
        positions[pair.second][pair.matches[:, 1]],
        relative.rotation.matrix(),
        np.asarray(relative.translation),
        PAIRS.max_error_px / (0.5 * (_focal_px(first) + _focal_px(second))),
    )


def _focal_px(image: pycolmap.Image) -> float:
    """The mean focal length of an image of a model."""
    assert image.camera is not None
    return float(image.camera.mean_focal_length())


def explains(check: PairCheck) -> bool:
    """Whether the model explains the pair: enough of its matches, and half of them."""
    return check.supported >= MIN_PAIR_MATCHES and check.supported >= PAIRS.explained_share * check.matches


def angle_deg(rotation: Array) -> float:
    """The angle of a rotation [3, 3] in degrees."""
    sine = np.linalg.norm(rotation - rotation.T) / np.sqrt(8.0)
    return float(np.degrees(np.arctan2(sine, (np.trace(rotation) - 1.0) / 2.0)))


def vector_angle_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """The angle between two vectors, in degrees."""
    cosine = first @ second / max(float(np.linalg.norm(first) * np.linalg.norm(second)), 1e-300)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def supported(
    first: Array, second: Array, rotation: Array, translation: Array, max_error: float
) -> NDArray[np.bool_]:
    """Which matches of rays [M, 2] lie near their epipolar lines (Sampson) and in front of both cameras."""
    tx, ty, tz = translation
    essential = np.array([[0.0, -tz, ty], [tz, 0.0, -tx], [-ty, tx, 0.0]]) @ rotation
    errors = np.asarray(pycolmap.compute_squared_sampson_error(first, second, essential))
    near = (errors <= max_error**2) | ~essential.any()  # coinciding cameras have no epipolar lines
    # Depths a, b of the point nearest to both rays: a·u + t = b·y, in the least squares sense.
    x, y = np.c_[first, np.ones(len(first))], np.c_[second, np.ones(len(second))]
    u = x @ rotation.T
    uu, yy, uy = (u * u).sum(axis=1), (y * y).sum(axis=1), (u * y).sum(axis=1)
    ut, yt = u @ translation, y @ translation
    # Nearly parallel rays meet far away, in front or behind within the noise: they contradict nothing.
    sine_squared = 1.0 - uy**2 / (uu * yy)
    parallel = sine_squared < max_error**2
    ahead = (uy * yt - yy * ut > 0) & (uu * yt - uy * ut > 0)
    return np.asarray(near & (ahead | parallel))


def relative_pose(
    pair: VerifiedPair, first: pycolmap.Camera, second: pycolmap.Camera, keypoints: Mapping[int, Array]
) -> RigidTransform | None:
    """second_from_first from this pair's matches alone, with the model's intrinsics but not its poses.

    Intrinsics of the view graph calibration, or guessed ones, give rotations too poor for evidence.
    """
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    options.compute_relative_pose = True
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        first, keypoints[pair.first], second, keypoints[pair.second], pair.matches, options
    )
    if geometry.cam2_from_cam1 is None or not np.linalg.norm(geometry.cam2_from_cam1.translation) > 0:
        return None
    return rigid_from_pycolmap(geometry.cam2_from_cam1)


def _relative_errors(
    estimated: RigidTransform | None, rotation: Array, translation: Array, min_baseline: float
) -> tuple[float, float]:
    if estimated is None:
        return np.nan, np.nan
    rotation_error = angle_deg(estimated.rotation @ rotation.T)
    baseline = float(np.linalg.norm(translation))
    if baseline < min_baseline:
        return rotation_error, np.nan
    cosine = estimated.translation @ translation / (np.linalg.norm(estimated.translation) * baseline)
    return rotation_error, float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
