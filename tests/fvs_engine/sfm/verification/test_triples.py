"""A row of cameras, part of which is shifted along it: every pair fits, points in three images do not."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.verification.pair_check import check_pairs
from fvs_engine.sfm.verification.triples import TripleCheck, check_triples, inconsistent_images

IMAGES, NEIGHBOURS = 9, 3
CAMERA = pycolmap.Camera(model="PINHOLE", width=800, height=600, params=[700.0, 700.0, 400.0, 300.0])
NOISE_PX = 0.3


def row() -> NDArray[np.float64]:
    return np.column_stack([0.5 * np.arange(IMAGES), np.zeros((IMAGES, 2))])


def model(
    centres: NDArray[np.float64], *, turned: Mapping[int, float] | None = None
) -> pycolmap.Reconstruction:
    """Cameras that look along z, ids from 1; ``turned`` has angles about z in degrees by id."""
    made = pycolmap.Reconstruction()
    CAMERA.camera_id = 1
    made.add_camera_with_trivial_rig(CAMERA)
    for image_id, centre in enumerate(centres, start=1):
        angle = np.radians((turned or {}).get(image_id, 0.0))
        rotation = pycolmap.Rotation3d(np.array([0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)]))
        pose = pycolmap.Rigid3d(rotation, -(rotation.matrix() @ centre))
        image = pycolmap.Image(name=str(image_id), camera_id=1, image_id=image_id)
        made.add_image_with_trivial_frame(image, pose)
    return made


def observed(
    centres: NDArray[np.float64], depth: tuple[float, float] = (4.0, 8.0)
) -> tuple[list[VerifiedPair], dict[int, NDArray[np.float64]]]:
    """Pairs of neighbours and key points: each image sees every point, with noise."""
    generator = np.random.default_rng(0)
    points = generator.uniform([-2, -2, depth[0]], [6, 2, depth[1]], size=(300, 3))
    keypoints = {}
    for image_id, centre in enumerate(centres, start=1):
        seen = points - centre
        noise = generator.normal(scale=NOISE_PX, size=(300, 2))
        keypoints[image_id] = 700.0 * seen[:, :2] / seen[:, 2:] + [400.0, 300.0] + noise
    matches = np.tile(np.arange(300, dtype=np.uint32)[:, None], 2)
    ids = range(1, IMAGES + 1)
    pairs = [VerifiedPair(i, j, matches) for i in ids for j in ids if i < j <= i + NEIGHBOURS]
    return pairs, keypoints


def found(poses: pycolmap.Reconstruction, depth: tuple[float, float] = (4.0, 8.0)) -> frozenset[str]:
    pairs, keypoints = observed(row(), depth)
    return inconsistent_images(poses, check_triples(poses, pairs, keypoints))


def test_a_right_row_is_consistent():
    assert found(model(row())) == frozenset()


@pytest.mark.parametrize("shift", [-0.3, 0.3, 2.0])
def test_the_end_of_a_row_that_is_shifted_along_it_is_named_though_every_pair_fits(shift: float):
    centres = row()
    centres[6:, 0] += shift
    poses = model(centres)
    pairs, keypoints = observed(row())
    checks = check_pairs(poses, pairs, keypoints, relative_poses=False)
    assert all(check.supported > 0.95 * check.matches for check in checks)
    assert found(poses) == {"7", "8", "9"}


def test_a_single_image_that_is_shifted_is_named():
    centres = row()
    centres[8, 0] += 0.3
    assert found(model(centres)) == {"9"}


def test_points_too_far_away_for_their_depth_to_be_known_say_nothing():
    centres = row()
    centres[6:, 0] += 0.3
    assert found(model(centres), depth=(400.0, 800.0)) == frozenset()


def test_matches_that_already_contradict_their_pair_do_not_count():
    pairs, keypoints = observed(row())
    points = [
        sum(check.points for check in check_triples(poses, pairs, keypoints) if 9 in check.images)
        for poses in (model(row()), model(row(), turned={9: 30.0}))
    ]
    assert points[1] < 0.1 * points[0]


def test_a_group_is_named_when_most_points_across_fail_and_only_then():
    posed = {i: SimpleNamespace(name=str(i), has_pose=True) for i in range(6)}
    poses: Any = SimpleNamespace(images=posed)
    inside = [TripleCheck((0, 1, 2), 90, 90), TripleCheck((1, 2, 3), 90, 90)]
    across = TripleCheck((2, 3, 4), 40, 10)
    assert inconsistent_images(poses, [*inside, across]) == {"4"}
    assert inconsistent_images(poses, [*inside, across, TripleCheck((1, 3, 4), 60, 60)]) == frozenset()
    assert inconsistent_images(poses, [*inside, TripleCheck((2, 3, 4), 14, 0)]) == frozenset()
    assert inconsistent_images(poses, []) == frozenset()
