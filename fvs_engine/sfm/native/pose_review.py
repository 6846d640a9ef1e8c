"""Poses of registered images that hang on few points, estimated again from all their matches.

COLMAP takes a pose that most matches fit to 12 px, and bundle adjustment moves image and points to the
nearest minimum. Where a hundred points hold an image, matches that are 2 px off can make that the wrong one,
several percent of the scene away. It stays the nearest minimum, also when later images would show the right
one (ADR 46).
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import VerifiedPair, read_verified_pairs
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap, rigid_to_pycolmap
from fvs_engine.sfm.native.known_points import camera_of, points_seen
from fvs_engine.sfm.native.pose_search import MIN_POSE_POINTS, MIN_SIGMA_PX, best_pose
from fvs_engine.sfm.native.prior_pose import Array, ExpectedPose, cost, project
from fvs_engine.sfm.native.robust_adjustment import error_sigma_px
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs

_FEW_POINTS = 200
"""Number of points, seen by two other images, below which an image hangs on few points."""

_LOWER_COST = 5.0
"""By how much another pose must lower the cost: about the number of matches that only the other fits."""

_STILL_EXPLAINED = 0.9
"""Share of the verified matches that the old pose explains, which another one must explain at least.

Those of a look-alike place fit well where points are, and contradict what only two images show.
"""

_FITTING_PX = pycolmap.IncrementalMapperOptions().filter_max_reproj_error
"""Maximum error of an observation."""


def hangs_on_few_points(model: pycolmap.Reconstruction, image: pycolmap.Image) -> bool:
    """Whether two other images see few of an image's points, too, so that its pose may be a wrong one."""
    if image.num_points3D >= 5 * _FEW_POINTS:  # counting is slow, and many of so many are seen by others
        return False
    tracks = (
        model.point3D(point.point3D_id).track.length() for point in image.points2D if point.has_point3D()
    )
    return sum(length >= 3 for length in tracks) < _FEW_POINTS


def review_poses(
    model: pycolmap.Reconstruction,
    observations: pycolmap.ObservationManager,
    database: Path,
    among: Collection[int],
    expected: Mapping[str, ExpectedPose],
    seed: int,
) -> list[str]:
    """Replace poses by others that explain an image's matches better; returns the names of these images.

    Only of registered images that hang on few points, ``among`` those with these ids. The error of a pose is
    judged by points as the other images see them, and by the ``expected`` pose where there is one (by name),
    both robustly. The images' observations are replaced, too; bundle adjustment should follow.
    """
    registered = set(model.reg_image_ids())
    few = [
        image
        for image_id in sorted(registered.intersection(among))
        if hangs_on_few_points(model, image := model.image(image_id))
    ]
    if not few:
        return []
    sigma_px = max(error_sigma_px(model), MIN_SIGMA_PX)
    pairs = [
        pair
        for pair in read_verified_pairs(database, MIN_PAIR_MATCHES, [image.name for image in few])
        if registered.issuperset((pair.first, pair.second))
    ]
    changed = []
    for image in few:
        own = [pair for pair in pairs if image.image_id in (pair.first, pair.second)]
        matches = points_seen(model, image.image_id, own)
        pose = _better_pose(model, image, matches, sigma_px, expected.get(image.name), seed)
        if pose is not None and _still_explains(model, image, pose, own):
            _replace(model, observations, image, pose, matches)
            changed.append(image.name)
    return changed


def _better_pose(
    model: pycolmap.Reconstruction,
    image: pycolmap.Image,
    matches: Sequence[tuple[int, int]],
    sigma_px: float,
    expected: ExpectedPose | None,
    seed: int,
) -> RigidTransform | None:
    """A pose that explains ``matches`` (feature, point) clearly better than the image's own; None without."""
    seen = [
        (xyz, image.point2D(feature).xy)
        for feature, point in matches
        if (xyz := _seen_by_others(model, point, image.image_id)) is not None
    ]
    if len(seen) < MIN_POSE_POINTS:
        return None
    points, pixels = (np.stack(column) for column in zip(*seen, strict=True))
    camera, own = camera_of(image), rigid_from_pycolmap(image.cam_from_world())
    best = best_pose(own, points, pixels, camera, sigma_px, expected, seed)
    given = points, pixels, camera, sigma_px, expected
    return best if cost(own, *given) - cost(best, *given) > _LOWER_COST else None


def _seen_by_others(model: pycolmap.Reconstruction, point_id: int, image_id: int) -> Array | None:
    """The position [3] of a point by the other images that see it; None if they are fewer than two."""
    point = model.point3D(point_id)
    elements = point.track.elements
    others = [element for element in elements if element.image_id != image_id]
    if len(others) < 2:
        return None
    return np.asarray(point.xyz) if len(others) == len(elements) else _triangulated(model, others)


def _triangulated(model: pycolmap.Reconstruction, track: Sequence[pycolmap.TrackElement]) -> Array | None:
    """The point [3] nearest to the rays of the observations in a ``track``; None at infinity."""
    rows = []
    for element in track:
        image = model.image(element.image_id)
        x, y = np.asarray(camera_of(image).cam_from_img(image.point2D(element.point2D_idx).xy)).reshape(2)
        pose = image.cam_from_world().matrix()
        rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
    *xyz, scale = np.linalg.svd(np.stack(rows))[2][-1]
    return np.array(xyz) / scale if abs(scale) > 1e-12 else None


def _still_explains(
    model: pycolmap.Reconstruction, image: pycolmap.Image, pose: RigidTransform, own: Sequence[VerifiedPair]
) -> bool:
    """Whether another pose explains an image's ``own`` verified matches nearly as well as its present one."""
    near = {i for pair in own for i in (pair.first, pair.second)}
    keypoints = {i: np.array([point.xy for point in model.image(i).points2D]) for i in near}

    def explained() -> int:
        return sum(check.supported for check in check_pairs(model, own, keypoints, relative_poses=False))

    frame = model.frame(image.frame_id)
    present, before = frame.rig_from_world, explained()
    frame.rig_from_world = rigid_to_pycolmap(pose)
    after = explained()
    frame.rig_from_world = present
    return after >= _STILL_EXPLAINED * before


def _replace(
    model: pycolmap.Reconstruction,
    observations: pycolmap.ObservationManager,
    image: pycolmap.Image,
    pose: RigidTransform,
    matches: Collection[tuple[int, int]],
) -> None:
    """Give an image another pose, and the observations among its ``matches`` (feature, point) that fit it.

    Points that it shares with only one image move with it: where a model begins to grow there may be hardly
    any others.
    """
    model.frame(image.frame_id).rig_from_world = rigid_to_pycolmap(pose)
    used = set()
    for feature, seen in enumerate(image.points2D):
        if not seen.has_point3D():
            continue
        point = model.point3D(seen.point3D_id)
        track = point.track.elements
        xyz = _triangulated(model, track) if len(track) == 2 else np.asarray(point.xyz)
        checked = track if len(track) == 2 else [pycolmap.TrackElement(image.image_id, feature)]
        if xyz is None or not all(_fits(model, element, xyz) for element in checked):
            observations.delete_observation(image.image_id, feature)
        else:
            point.xyz = xyz
            used.add(seen.point3D_id)
    for feature, point_id in matches:
        if image.point2D(feature).has_point3D() or point_id in used or not model.exists_point3D(point_id):
            continue
        element = pycolmap.TrackElement(image.image_id, feature)
        if _fits(model, element, np.asarray(model.point3D(point_id).xyz)):
            observations.add_observation(point_id, element)
            used.add(point_id)


def _fits(model: pycolmap.Reconstruction, element: pycolmap.TrackElement, xyz: Array) -> bool:
    """Whether an image sees a point where it observes it, to the limit of COLMAP's mapper."""
    image = model.image(element.image_id)
    pose = rigid_from_pycolmap(image.cam_from_world())
    seen, _ = project(camera_of(image), pose, xyz[None])
    observed = image.point2D(element.point2D_idx).xy
    return bool(np.linalg.norm(seen[0] - observed) <= _FITTING_PX)
