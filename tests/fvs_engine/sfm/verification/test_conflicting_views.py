"""Images that should show the same, by their poses, and do not."""

import numpy as np
import pycolmap
import pytest

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import rigid_to_pycolmap
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.conflicting_views import conflicting_views

CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=800, height=600, params=np.array([700.0, 400.0, 300.0]), camera_id=1
)
NAMES = ["a.jpg", "b.jpg", "c.jpg"]
CONFLICT = ("a.jpg", "b.jpg")


class Place:
    """Three cameras side by side before a wall; the first misses the points of the right part of the wall.

    Those with x from ``missing_from`` and y up to ``missing_to``. There it has other features, unless it is
    ``blank``.
    """

    def __init__(
        self,
        apart: float = 0.05,
        missing_from: float = 0.0,
        missing_to: float = 3.0,
        half_width: float = 3.0,
        *,
        blank: bool = False,
    ) -> None:
        random = np.random.default_rng(0)
        wall = random.uniform([-half_width, -2.2, 5.0], [half_width, 2.2, 5.5], (1500, 3))
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
            own = inside & ~missing if number == 1 else inside
            others = inside & ~own & (not blank)
            keypoints = np.concatenate([pixels[own], pixels[others] + 3.0]).clip(0, 799)
            image = pycolmap.Image(name=name, keypoints=keypoints, camera_id=1, image_id=number)
            self.model.add_image_with_trivial_frame(image, rigid_to_pycolmap(pose))
            self.keypoints[number], self.seen[number] = keypoints, list(np.flatnonzero(own))
            for feature, point in enumerate(self.seen[number]):
                tracks[point].add_element(number, feature)
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


@pytest.mark.parametrize(
    "place",
    [
        Place(missing_from=10.0),
        Place(missing_from=1.43, missing_to=1.0),  # 12 of 64 cells
        Place(half_width=0.6),  # 8 of 16 cells
        Place(blank=True),
        Place(apart=1.2),  # seen from 13° away
    ],
    ids=["all seen", "a fifth is missing", "few cells", "nothing there", "another direction"],
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
