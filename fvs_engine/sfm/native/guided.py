"""The native job that registers images by matches that their expected poses guide."""

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import image_cameras, image_ids
from fvs_engine.sfm.colmap.guided_pairs import Pair, take_back_guided_pairs, write_guided_pairs
from fvs_engine.sfm.colmap.model import camera_poses, rigid_to_pycolmap
from fvs_engine.sfm.jobs import GuidedRegistration, RegisterGuided, Report
from fvs_engine.sfm.native.guided_matching import GuidedPose, guided_pose
from fvs_engine.sfm.native.known_points import Features, Indices, KnownPoints, camera_of
from fvs_engine.sfm.native.prior_pose import ExpectedPose, expected_poses
from fvs_engine.sfm.native.registration import color_points, register
from fvs_engine.sfm.native.thresholds import GUIDED
from fvs_engine.sfm.native.two_view_points import add_two_view_points
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, supported
from fvs_engine.sfm.verification.prior_frame import PriorFrame, believed_frame


def register_guided(request: RegisterGuided, report: Report) -> GuidedRegistration:
    """See ``RegisterGuided``."""
    registration, neighbours = request.registration, request.neighbours
    database, priors = registration.database, registration.priors
    model = pycolmap.Reconstruction(registration.model_dir)
    poses = camera_poses(model)
    frame = believed_frame(priors, poses)
    if frame is None:
        return GuidedRegistration(looked_at=list(neighbours), registration=None)
    # Only intrinsics that the model has estimated: with a guessed focal length every window is wrong.
    estimated = {image.camera_id for image in model.images.values() if image.has_pose}
    cameras = image_cameras(database)
    ready = [name for name in neighbours if cameras[name] in estimated]
    if not ready:
        return GuidedRegistration(looked_at=list(neighbours), registration=None)
    take_back_guided_pairs(database, poses)  # of a call that crashed
    points = set(model.point3D_ids())
    add_two_view_points(model, database, sorted({other for some in neighbours.values() for other in some}))
    expected = _expected_poses(ready, request.tried, priors, frame, poses)
    found, matched = _guided_geometries(model, database, neighbours, expected)
    looked_at = [name for name in neighbours if name not in ready or name in matched]
    if not found:
        return GuidedRegistration(looked_at=looked_at, registration=None)
    color_points(model, registration.image_dir, points, ())
    write_guided_pairs(database, found)
    with tempfile.TemporaryDirectory() as folder:
        model.write_binary(folder)
        grown = registration.adjusted_points + model.num_points3D() - len(points)
        update = {"model_dir": Path(folder), "adjusted_points": grown, "two_view_points": True}
        answer = register(registration.model_copy(update=update), report)
    take_back_guided_pairs(database, answer.posed)
    return GuidedRegistration(looked_at=looked_at, registration=answer)


def _expected_poses(
    names: Sequence[str],
    tried: Sequence[str],
    priors: PosePriors,
    frame: PriorFrame,
    poses: Mapping[str, RigidTransform],
) -> dict[str, ExpectedPose]:
    """Expected poses of the images to match, in the order of matching.

    The first one, then those not ``tried``, those nearest to a registered camera first, then the others.
    """
    expected = expected_poses(names, priors, frame)
    centres = np.stack([pose.translation for pose in poses.values()])
    away = {
        name: float(np.linalg.norm(centres - pose.centre, axis=1).min()) for name, pose in expected.items()
    }
    turn = {name: number for number, name in enumerate(tried)}
    ordered = sorted(expected, key=lambda name: (name != names[0], turn.get(name, -1), away[name]))
    return {name: expected[name] for name in ordered[: GUIDED.max_looked_at]}


def _guided_geometries(
    model: pycolmap.Reconstruction,
    database: Path,
    neighbours: Mapping[str, Sequence[str]],
    expected: Mapping[str, ExpectedPose],
) -> tuple[dict[Pair, pycolmap.TwoViewGeometry], list[str]]:
    """The two-view geometries that guided matches give, by pairs of image ids, the smaller one first.

    Also returns the images that were matched, or cannot be.
    """
    ids, cameras = image_ids(database), image_cameras(database)
    geometries: dict[Pair, pycolmap.TwoViewGeometry] = {}
    looked_at, matched = list[str](), 0
    with closing(pycolmap.Database.open(database)) as opened:
        for name, pose in expected.items():
            if matched == GUIDED.max_guided:
                break
            looked_at.append(name)
            photograph = _Photograph(ids[name], model.camera(cameras[name]), Features.read(opened, ids[name]))
            images = [model.find_image_with_name(other) for other in neighbours[name]]
            known = KnownPoints.read(model, opened, images)
            guided = guided_pose(known, photograph.features, photograph.camera, pose)
            matched += guided is not None
            if guided is not None and guided.believed:
                for image in images:
                    matches = _matches(opened, photograph, image, known, guided)
                    if len(matches) >= MIN_PAIR_MATCHES:
                        pair, geometry = _geometry(photograph, guided, image, matches)
                        geometries[pair] = geometry
    return geometries, looked_at


@dataclass(frozen=True, eq=False)
class _Photograph:
    """An image that is not registered, by its id in the database, its camera and its features."""

    image_id: int
    camera: pycolmap.Camera
    features: Features


def _matches(
    database: pycolmap.Database,
    photograph: _Photograph,
    other: pycolmap.Image,
    known: KnownPoints,
    guided: GuidedPose,
) -> Indices:
    """Matches [M, 2] of an image with a registered one: guided ones, verified ones, and others that fit.

    Verified ones stay even when they do not fit, as evidence against the pose, unless a guided one has one of
    their features.
    """
    image_id, camera, features = photograph.image_id, photograph.camera, photograph.features
    here = known.image == other.image_id
    shown = dict(zip(known.point[here].tolist(), known.feature[here].tolist(), strict=True))
    guided_ones = [
        (feature, shown[point])
        for point, feature in zip(guided.points.tolist(), guided.features.tolist(), strict=True)
        if point in shown
    ]
    found = [np.array(guided_ones, dtype=np.int64).reshape(-1, 2)]
    if database.exists_two_view_geometry(image_id, other.image_id):
        verified = database.read_two_view_geometry(image_id, other.image_id)
        found.append(np.asarray(verified.inlier_matches, dtype=np.int64).reshape(-1, 2))
    if database.exists_matches(image_id, other.image_id):
        matched = np.asarray(database.read_matches(image_id, other.image_id), dtype=np.int64).reshape(-1, 2)
        theirs = np.asarray(database.read_keypoints(other.image_id), dtype=np.float64)[:, :2]
        relative = other.cam_from_world() * rigid_to_pycolmap(guided.camera_from_model.inverse())
        fits = supported(
            np.asarray(camera.cam_from_img(features.pixels[matched[:, 0]])).reshape(-1, 2),
            np.asarray(camera_of(other).cam_from_img(theirs[matched[:, 1]])).reshape(-1, 2),
            relative.rotation.matrix(),
            np.asarray(relative.translation),
            GUIDED.max_epipolar,
        )
        found.append(matched[fits])
    return _one_to_one(np.concatenate(found))


def _one_to_one(matches: Indices) -> Indices:
    """The ``matches`` [M, 2] that share no feature with an earlier one."""
    used: tuple[set[int], set[int]] = (set(), set())
    kept = []
    for first, second in matches.tolist():
        if first not in used[0] and second not in used[1]:
            used[0].add(first)
            used[1].add(second)
            kept.append((first, second))
    return np.array(kept, dtype=np.int64).reshape(-1, 2)


def _geometry(
    photograph: _Photograph, guided: GuidedPose, other: pycolmap.Image, matches: Indices
) -> tuple[Pair, pycolmap.TwoViewGeometry]:
    """The pair, and its two-view geometry by the guided pose."""
    guided_from_model = rigid_to_pycolmap(guided.camera_from_model)
    second_from_first = other.cam_from_world() * guided_from_model.inverse()
    first, second = (
        np.linalg.inv(each.calibration_matrix()) for each in (photograph.camera, camera_of(other))
    )
    pair = photograph.image_id, other.image_id
    if pair[0] > pair[1]:
        second_from_first, matches, pair = second_from_first.inverse(), matches[:, ::-1], pair[::-1]
        first, second = second, first
    essential = pycolmap.essential_matrix_from_pose(second_from_first)
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
    geometry.inlier_matches = np.ascontiguousarray(matches, dtype=np.uint32)
    geometry.cam2_from_cam1 = second_from_first
    geometry.E, geometry.F = essential, second.T @ essential @ first
    return pair, geometry
