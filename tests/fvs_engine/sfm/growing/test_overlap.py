import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.sfm.growing.overlap import most_overlapping, predicted_neighbours
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.views import View

CAMERA = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)
COUNT = 24


def outwards(k: float) -> RigidTransform:
    """A camera on a ring of radius 2 that looks away from its middle: model_from_camera."""
    angle = 2.0 * np.pi * k / COUNT
    centre = np.array([2.0 * np.cos(angle), 2.0 * np.sin(angle), 0.2 * np.sin(5 * angle)])
    return look_at(centre, 5.0 * centre, np.array([0.0, 0.0, 1.0]))


@pytest.fixture(scope="module")
def room() -> Reconstruction:
    """Cameras in the middle of a round room, and points on its walls."""
    random = np.random.default_rng(0)
    angles, heights = random.uniform(0.0, 2.0 * np.pi, 4000), random.uniform(-3.0, 3.0, 4000)
    walls = np.stack([10.0 * np.cos(angles), 10.0 * np.sin(angles), heights], axis=1)
    points = PointCloud(walls, np.zeros((4000, 3), np.uint8))
    views = (View(f"{k:02}", CAMERA, outwards(k).inverse()) for k in range(COUNT))
    return Reconstruction(tuple(views), points, np.zeros(4000))


def test_neighbours_by_overlap_look_at_the_same_wall(room: Reconstruction):
    found = most_overlapping(outwards(6.1), CAMERA, room, 5)
    assert found[0] == "06"
    assert set(found) == {"04", "05", "06", "07", "08"}


def test_a_camera_that_looks_the_other_way_overlaps_others_than_those_beside_it(room: Reconstruction):
    """The nearest cameras are 06 and 07."""
    backwards = outwards(6.5)
    turned = RigidTransform(backwards.rotation @ np.diag([-1.0, 1.0, -1.0]), backwards.translation)
    found = most_overlapping(turned, CAMERA, room, 4)
    assert set(found) == {"17", "18", "19", "20"}


def test_neighbours_are_predicted_from_whole_priors_that_are_believed(room: Reconstruction):
    poses = {view.name: view.camera_from_model.inverse() for view in room.views}
    new = {"new": outwards(6.1), "no orientation": outwards(3.0)}
    by_name = {name: PosePrior.of_camera(pose, 0.01, 2.0) for name, pose in (poses | new).items()}
    by_name["no orientation"] = PosePrior.at(outwards(3.0).translation, 0.01)
    priors = PosePriors(by_name=by_name)
    found = predicted_neighbours(["new", "no orientation", "without a prior"], priors, room)
    assert list(found) == ["new"]
    assert found["new"][0] == "06"
    for vague in ({"position_sigma": 100.0}, {"orientation_sigma_deg": 90.0}):
        uncertain = PosePriors(by_name=by_name | {"new": by_name["new"].model_copy(update=vague)})
        assert predicted_neighbours(["new"], uncertain, room) == {}
    mixed = dict(zip(by_name, np.random.default_rng(0).permutation(list(by_name)).tolist(), strict=True))
    shuffled = PosePriors(by_name={name: by_name[other] for name, other in mixed.items()})
    assert predicted_neighbours(["new"], shuffled, room) == {}
