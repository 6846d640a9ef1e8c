"""Evidence for a model's poses from the two-view geometries, which do not depend on the model.

A mapper minimises the error of the matches that it kept; it reports a good fit even after discarding those
that contradict it. So every verified match of every pair is checked again here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.verification.positions import misplaced, residual_share

Array = NDArray[np.float64]

MIN_PAIR_MATCHES = 15
"""COLMAP's own limit for a verified pair."""

_MAX_EPIPOLAR_ERROR_PX = 4.0
"""The threshold of COLMAP's verification: a right pose explains what passed it."""

_MAX_ROTATION_DEG = 5.0
_MAX_DIRECTION_DEG = 15.0
_MIN_BASELINE_SHARE = 0.02
"""Baselines below this share of the scene's spread have no reliable direction."""

_EXPLAINED = 0.5
"""A pair is explained when half of its matches are."""

_MAX_TRIPLETS = 20_000


@dataclass(frozen=True, eq=False)
class PairCheck:
    """One pair against a model; angles in degrees, NaN when there is nothing to compare."""

    first: int
    second: int
    matches: int
    supported: int
    rotation_error_deg: float
    direction_error_deg: float


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
    only the matches are counted, which takes a hundredth of the time. ``on_pair`` is called before each pair
    and may raise to stop.
    """
    posed = {i: image for i, image in model.images.items() if image.has_pose}
    spread = centre_spread(np.array([image.projection_center() for image in posed.values()]))
    rays = {
        i: np.asarray(image.camera.cam_from_img(keypoints[i])) for i, image in posed.items() if i in keypoints
    }
    checks = []
    for pair in pairs:
        if on_pair is not None:
            on_pair()
        if pair.first not in rays or pair.second not in rays:
            continue
        first, second = posed[pair.first], posed[pair.second]
        relative = second.cam_from_world() * first.cam_from_world().inverse()
        rotation, translation = relative.rotation.matrix(), np.asarray(relative.translation)
        focal_px = 0.5 * (first.camera.mean_focal_length() + second.camera.mean_focal_length())
        supported = _supported(
            rays[pair.first][pair.matches[:, 0]],
            rays[pair.second][pair.matches[:, 1]],
            rotation,
            translation,
            _MAX_EPIPOLAR_ERROR_PX / focal_px,
        )
        rotation_error, direction_error = _relative_errors(
            relative_pose(pair, first.camera, second.camera, keypoints) if relative_poses else None,
            rotation,
            translation,
            _MIN_BASELINE_SHARE * spread,
        )
        checks.append(
            PairCheck(
                pair.first,
                pair.second,
                len(pair.matches),
                int(supported.sum()),
                rotation_error,
                direction_error,
            )
        )
    return checks


def explains(check: PairCheck) -> bool:
    """Whether the model explains the pair: enough of its matches, and half of them."""
    return check.supported >= MIN_PAIR_MATCHES and check.supported >= _EXPLAINED * check.matches


def gather_evidence(
    model: pycolmap.Reconstruction,
    pairs: Sequence[VerifiedPair],
    keypoints: Mapping[int, Array],
    priors: PosePriors,
    on_pair: Callable[[], None] | None = None,
) -> Evidence | None:
    """The evidence for ``model`` of pairs and priors; None when no verified pair lies within it.

    It takes a hundredth of a second per pair; ``on_pair`` is called before each and may raise to stop.
    """
    checks = check_pairs(model, pairs, keypoints, on_pair=on_pair)
    if not checks:
        return None
    posed = [image for image in model.images.values() if image.has_pose]
    centres = {image.name: np.asarray(image.projection_center()) for image in posed}
    matches = np.array([check.matches for check in checks], dtype=np.float64)
    supported = np.array([check.supported for check in checks], dtype=np.float64)
    rotation = np.array([check.rotation_error_deg for check in checks])
    direction = np.array([check.direction_error_deg for check in checks])
    return Evidence(
        pairs=len(checks),
        matches=int(matches.sum()),
        match_support=float(supported.sum() / matches.sum()),
        rotation_support=_weighted_share(rotation, _MAX_ROTATION_DEG, matches),
        translation_support=_weighted_share(direction, _MAX_DIRECTION_DEG, matches),
        cycle_consistency=cycle_consistency(pairs),
        unsupported_images=tuple(sorted({*_unsupported(model, checks), *misplaced(priors, centres)})),
        prior_residual_share=residual_share(priors, centres),
    )


def cycle_consistency(pairs: Sequence[VerifiedPair]) -> float | None:
    """Share of the triplets whose three relative rotations close to 5°; None without triplets."""
    rotations: dict[int, dict[int, Array]] = {}
    for pair in pairs:
        if pair.second_from_first is not None:
            rotations.setdefault(pair.first, {})[pair.second] = pair.second_from_first.rotation
    closed = total = 0
    for ahead in rotations.values():
        for b, b_from_a in ahead.items():
            for c, c_from_b in rotations.get(b, {}).items():
                if c in ahead:
                    total += 1
                    closed += angle_deg(ahead[c].T @ c_from_b @ b_from_a) < _MAX_ROTATION_DEG
                    if total == _MAX_TRIPLETS:
                        return closed / total
    return closed / total if total > 0 else None


def angle_deg(rotation: Array) -> float:
    """The angle of a rotation [3, 3] in degrees."""
    sine = np.linalg.norm(rotation - rotation.T) / np.sqrt(8.0)
    return float(np.degrees(np.arctan2(sine, (np.trace(rotation) - 1.0) / 2.0)))


def _supported(
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
    # Nearly parallel rays meet far away, on either side within the noise: they contradict nothing.
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


def _weighted_share(errors_deg: Array, limit_deg: float, weights: Array) -> float | None:
    known = np.isfinite(errors_deg)
    if not known.any():
        return None
    return float((weights[known] * (errors_deg[known] < limit_deg)).sum() / weights[known].sum())


def _unsupported(model: pycolmap.Reconstruction, checks: Sequence[PairCheck]) -> list[str]:
    """Names of the images that explained pairs do not connect with the rest of the model.

    They are outside the largest component of explained pairs, or on the smaller side of a cut across which
    most matches contradict the poses, though some pairs fit. A group of images that is consistent in itself,
    and wrong relative to the rest, looks like that.
    """
    ids = sorted(i for i, image in model.images.items() if image.has_pose)
    index = {image_id: k for k, image_id in enumerate(ids)}
    ends = np.array([(index[check.first], index[check.second]) for check in checks])
    matches = np.array([check.matches for check in checks])
    supported = np.array([check.supported for check in checks])
    explained = np.array([explains(check) for check in checks])
    rows, columns = ends[explained].T
    # The spanning tree of the best supported pairs: an edge of it is the strongest link across its cut.
    tree = minimum_spanning_tree(
        coo_array((1.0 / supported[explained], (rows, columns)), shape=(len(ids),) * 2)
    )
    group = connected_components(tree, directed=False)[1]
    outside = group != np.argmax(np.bincount(group))
    tree = tree.tocoo()
    for k in np.flatnonzero(~outside[tree.row]):
        edges = np.arange(tree.nnz) != k
        cut = coo_array((tree.data[edges], (tree.row[edges], tree.col[edges])), shape=tree.shape)
        side = connected_components(cut, directed=False)[1]
        here, there = side == side[tree.row[k]], side == side[tree.col[k]]
        across = (here[ends[:, 0]] & there[ends[:, 1]]) | (there[ends[:, 0]] & here[ends[:, 1]])
        if supported[across].sum() < _EXPLAINED * matches[across].sum():
            outside |= here if here.sum() < there.sum() else there
    return [model.images[ids[k]].name for k in np.flatnonzero(outside)]
