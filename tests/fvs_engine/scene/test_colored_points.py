import numpy as np

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.scene.seeding import colored
from fvs_engine.sfm.growing.two_view_points import TwoViewPoints
from fvs_engine.splat.views import TrainingView


def test_points_have_the_colours_of_the_pixels_that_show_them():
    camera = PinholeCamera(4, 3, 1.0, 1.0, 2.0, 1.5)
    image = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
    views = [
        TrainingView("a.jpg", camera, RigidTransform.identity(), image),
        TrainingView("b.jpg", camera, RigidTransform(np.eye(3), np.array([0.0, 0.0, 2.0])), 100 + image),
    ]
    xyz = np.array(
        [
            [1.2, 0.9, 1.0],  # a.jpg: px (3.2, 2.4)
            [0.0, 0.0, -1.0],  # behind a.jpg
            [2.5, 0.0, 1.0],  # right of it
            [-3.0, -3.0, 0.0],  # b.jpg: px (0.5, 0)
        ]
    )
    found = colored(TwoViewPoints(xyz, np.array(["a.jpg", "a.jpg", "a.jpg", "b.jpg"])), views)
    assert found.xyz.tolist() == [xyz[0].tolist(), xyz[3].tolist()]
    assert found.colors.tolist() == [image[2, 3].tolist(), (100 + image[0, 0]).tolist()]


def test_points_of_no_view_are_left_out():
    assert len(colored(TwoViewPoints(np.ones((2, 3)), np.array(["a.jpg", "b.jpg"])), [])) == 0
