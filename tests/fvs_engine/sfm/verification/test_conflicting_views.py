"""Images that should show the same, by their poses, and do not."""

from itertools import combinations

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import camera_from_pycolmap, rigid_to_pycolmap
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.conflicting_views import conflicting_views

CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=800, height=600, params=np.array([700.0, 400.0, 300.0]), camera_id=1
)
NAMES = ["a.jpg", "b.jpg", "c.jpg"]
CONFLICT = ("a.jpg", "b.jpg")


class Place:
    """Three cameras side by side before a wall of ``points``; image ``lacking`` misses those of a part.

    Those with x from ``missing_from`` and y up to ``missing_to``. There it has so many ``other`` features,
    which are ``points_of_its_own`` or none.
    """

    def __init__(
        self,
        apart: float = 0.05,
        missing_from: float = 0.0,
        missing_to: float = 3.0,
        half_width: float = 3.0,
        lacking: int = 1,
        points: int = 1500,
        other: int = 10_000,
        *,
        points_of_its_own: bool = False,
    ) -> None:
        random = np.random.default_rng(0)
        wall = random.uniform([-half_width, -2.2, 5.0], [half_width, 2.2, 5.5], (points, 3))
        missing = (wall[:, 0] >= missing_from) & (wall[:, 1] <= missing_to)
        self.model = pycolmap.Reconstruction()
        self.model.add_camera_with_trivial_rig(CAMERA)
        tracks = [pycolmap.Track() for _ in wall]
        self.keypoints: dict[int, np.ndarray] = {}
        self.seen: dict[int, list[int]] = {}
        for number, (name, x) in enumerate(zip(NAMES, (0.0, apart, apart + 0.05), strict=True), start=1):
            pose = RigidTransform(np.eye(3), np.array([-x, 0.0, 0.0]))
            pixels = np.asarray(CAMERA.img_from_cam(pose.apply(wall)))
            inside = ((pixels > 0) & (pixels < (800, 600))).all(axis=1)
            own = inside & ~missing if number == lacking else inside
            others = pixels[inside & ~own][:other]
            keypoints = np.concatenate([pixels[own], others + 3.0]).clip(0, 799)
            image = pycolmap.Image(name=name, keypoints=keypoints, camera_id=1, image_id=number)
            self.model.add_image_with_trivial_frame(image, rigid_to_pycolmap(pose))
            self.keypoints[number], self.seen[number] = keypoints, list(np.flatnonzero(own))
            for feature, point in enumerate(self.seen[number]):
                tracks[point].add_element(number, feature)
            if points_of_its_own:
                for feature in range(int(own.sum()), len(keypoints)):
                    track = pycolmap.Track()
                    track.add_element(number, feature)
                    self.model.add_point3D(np.array([0.0, 0.0, 5.0]), track, np.zeros(3, np.uint8))
        for xyz, track in zip(wall, tracks, strict=True):
            self.model.add_point3D(xyz, track, np.zeros(3, np.uint8))

    def pairs(self, share: float = 1.0) -> list[VerifiedPair]:
        """The pairs with that share of their matches."""
        found = []
        for first, second in ((1, 2), (1, 3), (2, 3)):
            other = {point: feature for feature, point in enumerate(self.seen[second])}
            matches = [(k, other[p]) for k, p in enumerate(self.seen[first]) if p in other]
            kept = matches[: int(share * len(matches))]
            found.append(VerifiedPair(first, second, np.array(kept, dtype=np.uint32)))
        return found

    def conflicts(self, share: float = 1.0) -> tuple[tuple[str, str], ...]:
        return conflicting_views(self.model, self.pairs(share), self.keypoints)


def test_an_image_conflicts_with_those_beside_it_whose_points_it_does_not_show():
    assert Place().conflicts() == (CONFLICT, ("a.jpg", "c.jpg"))


def test_points_that_no_other_image_shows_are_no_excuse():
    """The ground before each of two equal walls may have points of its own."""
    assert Place(points_of_its_own=True).conflicts() == (CONFLICT, ("a.jpg", "c.jpg"))


def test_either_image_of_a_pair_may_lack_the_other():
    assert Place(lacking=2).conflicts() == (CONFLICT, ("b.jpg", "c.jpg"))


def test_points_beyond_the_fold_of_a_distortion_do_not_count():
    """COLMAP's polynomial folds directions far from the axis back into the image."""
    lens = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=905, height=678, params=[500.0, 452.0, 339.0, -0.15], camera_id=1
    )
    camera, random = camera_from_pycolmap(lens), np.random.default_rng(1)
    points = random.normal(size=(30_000, 3))
    points *= 5.2 / np.linalg.norm(points, axis=1, keepdims=True)
    poses = []
    for number, yaw_deg in enumerate((0.0, -45.0, -60.0, -75.0)):
        turn = Rotation.from_euler("y", yaw_deg, degrees=True).as_matrix()
        poses.append(RigidTransform(turn, turn @ np.array([-0.1 * number, 0.0, 0.0])))
    pixels = [camera.project(pose.apply(points)) for pose in poses]
    visible = [((xy > 0) & (xy < (905, 678))).all(axis=1) for xy in pixels]
    tracks = [pycolmap.Track() for _ in points]
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(lens)
    keypoints, seen = {}, {}
    for number, (pose, xy, inside) in enumerate(zip(poses, pixels, visible, strict=True), start=1):
        keypoints[number], seen[number] = xy[inside], np.flatnonzero(inside)
        image = pycolmap.Image(name=f"{number}.jpg", keypoints=xy[inside], camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, rigid_to_pycolmap(pose))
        for feature, point in enumerate(seen[number]):
            tracks[point].add_element(number, feature)
    for xyz, track in zip(points, tracks, strict=True):
        if track.length() >= 2:
            model.add_point3D(xyz, track, np.zeros(3, np.uint8))
    pairs = []
    for first, second in combinations(seen, 2):
        _, a, b = np.intersect1d(seen[first], seen[second], return_indices=True)
        pairs.append(VerifiedPair(first, second, np.stack([a, b], axis=1).astype(np.uint32)))
    assert conflicting_views(model, pairs, keypoints) == ()


@pytest.mark.parametrize(
    "place",
    [
        Place(missing_from=10.0),
        Place(missing_from=1.43, missing_to=1.0),  # 12 of 64 cells
        Place(missing_to=0.0),  # 16 of 64 cells
        Place(half_width=1.05, missing_to=1.5),  # 12 of 32 cells
        Place(other=0),
        Place(other=100),  # three in a cell
        Place(points=110),  # two in a cell
        Place(apart=1.2),  # seen from 13° away
    ],
    ids=[
        "all seen",
        "a fifth is missing",
        "a quarter is missing",
        "few cells",
        "nothing there",
        "hardly anything there",
        "few points",
        "another direction",
    ],
)
def test_no_conflict(place: Place):
    assert place.conflicts() == ()


def test_images_that_few_matches_join_do_not_conflict():
    assert Place().conflicts(0.1) == ()
    assert Place().conflicts(0.5) != ()


def test_a_camera_that_is_much_nearer_does_not_conflict():
    place = Place()
    frame = place.model.frame(place.model.image(1).frame_id)
    frame.rig_from_world = rigid_to_pycolmap(RigidTransform(np.eye(3), np.array([0.0, 0.0, -1.2])))
    assert place.conflicts() == ()


def test_the_check_of_new_images_looks_at_their_pairs_alone():
    place = Place()
    check = PoseCheck(place.pairs(), place.keypoints, 0.75, PosePriors())
    assert check.conflicting(place.model, ["b.jpg"]) == [CONFLICT]
    assert check.conflicting(place.model, ["a.jpg"]) == [CONFLICT, ("a.jpg", "c.jpg")]
    assert check.conflicting(place.model, []) == []


def test_images_without_a_pose_are_left_out():
    place = Place()
    place.model.deregister_frame(place.model.image(1).frame_id)
    assert place.conflicts() == ()
