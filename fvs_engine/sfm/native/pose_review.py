"""Poses of registered images that hang on few points, estimated again from all their matches.

COLMAP takes a pose that most matches fit to 12 px, and bundle adjustment moves image and points to the
nearest minimum. Where a hundred points hold an image, matches that are 2 px off can make that the wrong one,
several percent of the scene away. It stays the nearest minimum, also when later images would show the right
one (docs/design/poses.md).
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.database import VerifiedPair, read_verified_pairs
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap, rigid_to_pycolmap
from fvs_engine.sfm.native.known_points import camera_of, points_seen
from fvs_engine.sfm.native.points_of_others import LIMITS, Matches, Rays, hangs_on_few_points
from fvs_engine.sfm.native.pose_search import best_pose
from fvs_engine.sfm.native.prior_pose import Array, ExpectedPose, PoseProblem, project
from fvs_engine.sfm.native.robust_adjustment import error_sigma_px
from fvs_engine.sfm.native.thresholds import POSES
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs


@dataclass(frozen=True, eq=False)
class PoseReview:
    """Review of the poses of a ``model``, whose matches are in ``database``.

    The error of a pose is judged by points as the other images see them, and by the expected pose that
    ``expected_of`` gives for its name, if any, both robustly. A new pose must explain the verified matches
    nearly as well. ``contradicts`` says whether something contradicts the pose of an image, by its id: a new
    pose that is contradicted replaces the old one only if that was contradicted, too.
    """

    model: pycolmap.Reconstruction
    observations: pycolmap.ObservationManager
    database: Path
    seed: int
    expected_of: Callable[[Collection[str]], Mapping[str, ExpectedPose]] = lambda _: {}
    contradicts: Callable[[int], bool] = lambda _: False

    def of(self, image_ids: Collection[int]) -> list[str]:
        """Replace poses by others that explain an image's matches better; returns the names of these images.

        Only of registered images that hang on few points, among those with the ``image_ids``. Observations
        are replaced, too; bundle adjustment should follow.
        """
        model, seed = self.model, self.seed
        registered = set(model.reg_image_ids())
        few = [
            image
            for image_id in sorted(registered.intersection(image_ids))
            if hangs_on_few_points(model, image := model.image(image_id))
        ]
        if not few:
            return []
        names = [image.name for image in few]
        pairs = defaultdict(list)
        for pair in read_verified_pairs(self.database, MIN_PAIR_MATCHES, names):
            if registered.issuperset((pair.first, pair.second)):
                pairs[pair.first].append(pair)
                pairs[pair.second].append(pair)
        expected, rays = self.expected_of(names), Rays(model)
        sigma_px = max(error_sigma_px(model), POSES.min_sigma_px)

        def better_pose(image: pycolmap.Image, matches: Matches) -> tuple[float, RigidTransform]:
            points = rays.points_of_others(image, matches)
            problem = PoseProblem(*points, camera_of(image), sigma_px, expected.get(image.name))
            return _better_pose(image, problem, seed)

        def matches_of(image: pycolmap.Image) -> Matches:
            return points_seen(model, image.image_id, pairs[image.image_id])

        # A wrong pose makes those of its neighbours look wrong, but less so than itself.
        gains = [(better_pose(image, matches_of(image))[0], image) for image in few]
        changed = []
        for gain, image in sorted(gains, key=lambda found: -found[0]):
            if gain <= POSES.min_gain:
                break
            matches = matches_of(image)
            gain, pose = better_pose(image, matches)
            if gain > POSES.min_gain and self._accept(image, pose, pairs[image.image_id]):
                _drop_misfits(model, self.observations, image, rays)
                _add_fitting(model, self.observations, image, matches)
                changed.append(image.name)
        return changed

    def _accept(self, image: pycolmap.Image, pose: RigidTransform, pairs: Sequence[VerifiedPair]) -> bool:
        """Give an image the new ``pose``, unless that explains clearly less, or only it is contradicted."""
        model, image_id = self.model, image.image_id
        frame, present = model.frame(image.frame_id), rigid_from_pycolmap(image.cam_from_world())
        explained, contradicted = _explained(model, pairs), self.contradicts(image_id)
        frame.rig_from_world = rigid_to_pycolmap(pose)
        enough = _explained(model, pairs) >= POSES.still_explained * explained
        if enough and (contradicted or not self.contradicts(image_id)):
            return True
        frame.rig_from_world = rigid_to_pycolmap(present)
        return False


def _better_pose(image: pycolmap.Image, problem: PoseProblem, seed: int) -> tuple[float, RigidTransform]:
    """The pose that solves the ``problem`` best, and by how much its cost is below that of the image's."""
    present = rigid_from_pycolmap(image.cam_from_world())
    if len(problem.points) < POSES.min_points:
        return 0.0, present
    best = best_pose(present, problem, seed)
    return problem.cost(present) - problem.cost(best), best


def _explained(model: pycolmap.Reconstruction, pairs: Sequence[VerifiedPair]) -> int:
    """The number of the verified matches of ``pairs`` that the poses explain."""
    near = {i for pair in pairs for i in (pair.first, pair.second)}
    keypoints = {i: np.array([point.xy for point in model.image(i).points2D]) for i in near}
    return sum(check.supported for check in check_pairs(model, pairs, keypoints, relative_poses=False))


def _drop_misfits(
    model: pycolmap.Reconstruction,
    observations: pycolmap.ObservationManager,
    image: pycolmap.Image,
    rays: Rays,
) -> None:
    """Delete the observations that do not fit an image's new pose.

    Points that it shares with only one image move with it: where a model begins to grow there may be hardly
    any others.
    """
    for feature, seen in enumerate(image.points2D):
        if not seen.has_point3D():
            continue
        point = model.point3D(seen.point3D_id)
        track = point.track.elements
        if len(track) > 2:
            fits = _fits(model, pycolmap.TrackElement(image.image_id, feature), np.asarray(point.xyz))
        elif (xyz := rays.triangulated(track)) is not None:
            point.xyz = xyz
            fits = all(_fits(model, element, xyz) for element in track)
        else:
            fits = False
        if not fits:
            observations.delete_observation(image.image_id, feature)


def _add_fitting(
    model: pycolmap.Reconstruction,
    observations: pycolmap.ObservationManager,
    image: pycolmap.Image,
    matches: Matches,
) -> None:
    """Add the observations among the ``matches`` that fit an image's new pose."""
    used = {point.point3D_id for point in image.points2D if point.has_point3D()}
    for feature, point_id in matches:
        if image.point2D(feature).has_point3D() or point_id in used or not model.exists_point3D(point_id):
            continue
        element = pycolmap.TrackElement(image.image_id, feature)
        if _fits(model, element, np.asarray(model.point3D(point_id).xyz)):
            observations.add_observation(point_id, element)
            used.add(point_id)


def _fits(model: pycolmap.Reconstruction, element: pycolmap.TrackElement, xyz: Array) -> bool:
    """Whether an image sees a point where it observes it."""
    image = model.image(element.image_id)
    seen, _ = project(camera_of(image), rigid_from_pycolmap(image.cam_from_world()), xyz[None])
    observed = image.point2D(element.point2D_idx).xy
    return bool(np.linalg.norm(seen[0] - observed) <= LIMITS.filter_max_reproj_error)
