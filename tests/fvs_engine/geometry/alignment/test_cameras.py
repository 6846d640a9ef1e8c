import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform
from fvs_engine.geometry.alignment.cameras import align_poses

B_FROM_A = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)


def test_cameras_on_a_line_are_aligned_without_turning_about_it():
    line = {
        f"{i}.jpg": RigidTransform(Rotation.from_euler("y", 3 * i, degrees=True).as_matrix(), [0.5 * i, 0, 0])
        for i in range(6)
    }
    turned = {
        name: RigidTransform(B_FROM_A.rotation @ pose.rotation, B_FROM_A.apply(pose.translation))
        for name, pose in line.items()
    }
    found = align_poses(line, turned).transform
    np.testing.assert_allclose(found.rotation, B_FROM_A.rotation, atol=1e-9)
    assert found.scale == pytest.approx(B_FROM_A.scale)
    np.testing.assert_allclose(found.translation, B_FROM_A.translation, atol=1e-8)


def test_one_camera_that_moved_does_not_move_the_others():
    rng = np.random.default_rng(0)
    poses = {
        f"{i}.jpg": RigidTransform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
        for i in range(11)
    }
    moved = dict(poses)
    name = min(moved)
    moved[name] = RigidTransform(moved[name].rotation, moved[name].translation + 1.0)
    found = align_poses(moved, poses).transform
    assert found.scale == pytest.approx(1.0)
    np.testing.assert_allclose(found.translation, 0.0, atol=1e-8)
