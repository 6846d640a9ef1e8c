"""Guided matching: an image's features against the points that its expected pose should see.

A match is searched within a window around the projected point. Its size follows from the standard deviations
of the expected pose and the depth of the point. At 5° windows are wide and contain many look-alikes: the
camera rotation that most matches agree on is found first, then the windows shrink. A feature must also have
about the size and orientation that the pose predicts. The significance of the matches is estimated from
displaced windows, in which every match is a chance match.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.native.known_points import Features, Indices, KnownPoints
from fvs_engine.sfm.native.prior_pose import Array, ExpectedPose, PoseProblem, project
from fvs_engine.sfm.native.thresholds import GUIDED

_BESIDE = np.array(GUIDED.displacements)


@dataclass(frozen=True, eq=False)
class GuidedPose:
    """A pose that matches support, those of known ``points`` [M] (indices) with ``features`` [M].

    ``by_chance``: the most matches in any set of displaced windows. ``sigmas``: the distance of position or
    orientation from those expected, in standard deviations.
    """

    camera_from_model: RigidTransform
    points: Indices
    features: Indices
    by_chance: int
    sigmas: float

    @property
    def believed(self) -> bool:
        """Whether there are many more matches than by chance, and the pose is near the expected one."""
        least = max(GUIDED.min_believed_matches, GUIDED.min_believed_ratio * self.by_chance)
        return len(self.points) >= least and self.sigmas <= GUIDED.max_believed_sigmas


def guided_pose(
    known: KnownPoints, features: Features, camera: pycolmap.Camera, expected: ExpectedPose
) -> GuidedPose | None:
    """The pose near the ``expected`` one that most matches support; None when hardly any match."""
    candidates = _Candidates.within_windows(known, features, camera, expected)
    if candidates is None:
        return None
    found = [pose for start in candidates.starts() if (pose := candidates.follow(start)) is not None]
    return max(found, key=lambda pose: (pose.believed, len(pose.points)), default=None)


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Pairs of a known ``point`` and a ``feature`` in its window, ordered by point and ``angle`` [rad]."""

    known: KnownPoints
    pixels: Array
    camera: pycolmap.Camera
    expected: ExpectedPose
    point: Indices
    feature: Indices
    angle: NDArray[np.float32]
    windows: Array
    """Radius [P] of each point's window in px."""

    @staticmethod
    def within_windows(
        known: KnownPoints, features: Features, camera: pycolmap.Camera, expected: ExpectedPose
    ) -> "_Candidates | None":
        focal = float(camera.mean_focal_length())
        chosen = known.seen_from(expected.centre, GUIDED.observations, GUIDED.max_angle_deg)
        pixels, depth = project(camera, expected.camera_from_model, known.xyz)
        turn = expected.orientation_sigma
        windows = focal * GUIDED.sigmas * np.hypot(expected.position_sigma / np.maximum(depth, 1e-9), turn)
        margin = focal * GUIDED.sigmas * turn
        inside = (depth > 0) & (pixels > -margin).all(axis=1)
        inside &= (pixels[:, 0] < camera.width + margin) & (pixels[:, 1] < camera.height + margin)
        points = np.unique(known.point[chosen[inside[known.point[chosen]]]])
        if len(points) < GUIDED.min_matches:
            return None
        wanted = np.zeros(len(known.xyz), dtype=bool)
        wanted[points[:: -(-len(points) // GUIDED.max_points)]] = True
        chosen = chosen[wanted[known.point[chosen]]]
        cosines = known.descriptors[chosen] @ features.descriptors.T
        # Descriptors that are farther apart do not even compete.
        alike = np.cos(np.radians(GUIDED.max_descriptor_deg) / min(GUIDED.first_ratio, GUIDED.ratio))
        observation, feature = np.nonzero(cosines > alike)
        angle = np.arccos(np.minimum(cosines[observation, feature], 1.0))
        # Displaced windows are covered, too: chance matches are counted there.
        reach = windows[known.point[chosen]] + focal * float(np.abs(_BESIDE).max())
        apart = pixels[known.point[chosen[observation]]] - features.pixels[feature]
        axes = _axes_px(known, chosen, camera, expected.camera_from_model)
        good = (apart**2).sum(axis=1) < reach[observation] ** 2
        good &= _alike(axes[observation], features.axes[feature])
        # Beyond the reach of a strong distortion's model a pixel has no ray.
        good &= np.isfinite(np.asarray(camera.cam_from_img(features.pixels))).all(axis=1)[feature]
        point, feature, angle = known.point[chosen[observation[good]]], feature[good], angle[good]
        order = np.lexsort((angle, feature, point))
        point, feature, angle = point[order], feature[order], angle[order]
        first = np.r_[True, (point[1:] != point[:-1]) | (feature[1:] != feature[:-1])][: len(point)]
        point, feature, angle = point[first], feature[first], angle[first]
        order = np.lexsort((angle, point))
        return _Candidates(
            known, features.pixels, camera, expected, point[order], feature[order], angle[order], windows
        )

    def match(
        self, pose: RigidTransform, radii: Array | float, ratio: float, beside: Array | None = None
    ) -> tuple[Indices, Indices]:
        """Points and features that match each other best within windows of ``radii`` px.

        ``beside`` displaces the windows, in px. ``ratio`` is that of the ratio test.
        """
        pixels, depth = project(self.camera, pose, self.known.xyz)
        if beside is not None:
            pixels = pixels + beside
        distance = ((pixels[self.point] - self.pixels[self.feature]) ** 2).sum(axis=1)
        limits = np.broadcast_to(np.asarray(radii, dtype=np.float64), len(depth))
        near = (distance < limits[self.point] ** 2) & (depth[self.point] > 0)
        point, feature, angle = self.point[near], self.feature[near], self.angle[near]
        if len(point) == 0:
            return point, feature
        first = np.r_[True, point[1:] != point[:-1]]
        following = np.r_[angle[1:], np.float32(np.inf)]
        following[np.r_[first[1:], True]] = np.inf
        best_of_feature = np.full(len(self.pixels), np.inf, dtype=angle.dtype)
        np.minimum.at(best_of_feature, feature, angle)
        good = first & (angle < ratio * following) & (angle <= best_of_feature[feature])
        good &= angle < np.radians(GUIDED.max_descriptor_deg)
        return point[good], feature[good]

    def starts(self) -> Iterator[tuple[RigidTransform, Indices, Indices]]:
        """Rotated poses and the matches that agree with each, the best supported first."""
        point, feature = self.match(self.expected.camera_from_model, self.windows, GUIDED.first_ratio)
        if len(point) < GUIDED.min_matches:
            return
        expected, rotation = self.expected, self.expected.camera_from_model.rotation
        towards = _unit((self.known.xyz[point] - expected.centre) @ rotation.T)
        shown = np.asarray(self.camera.cam_from_img(self.pixels[feature])).reshape(-1, 2)
        shown = _unit(np.c_[shown, np.ones(len(shown))])
        turns = _turns(towards, shown)
        away = np.median(np.linalg.norm(self.known.xyz[point] - expected.centre, axis=1))
        limit = np.cos(min(GUIDED.windows[0] + 1.5 * expected.position_sigma / away, GUIDED.max_apart_rad))
        agree = np.einsum("hij,pj,pi->hp", turns, towards, shown) > limit
        tried: list[Array] = []
        for best in np.argsort(-agree.sum(axis=1), kind="stable"):
            # The cosine of a turn's angle is (trace − 1) / 2.
            if any(0.5 * (np.trace(turns[best] @ other.T) - 1.0) > limit for other in tried):
                continue
            tried.append(turns[best])
            yield expected.turned(turns[best]), point[agree[best]], feature[agree[best]]
            if len(tried) == GUIDED.hypotheses:
                return

    def follow(self, start: tuple[RigidTransform, Indices, Indices]) -> GuidedPose | None:
        """Refine a starting pose with shrinking windows."""
        pose, point, feature = start
        focal = float(self.camera.mean_focal_length())
        noise = GUIDED.windows[0] / GUIDED.window_sigmas
        for radius in GUIDED.windows:
            pose = self._problem(point, feature, noise * focal).refine(pose)
            point, feature = self.match(pose, radius * focal, GUIDED.ratio)
            noise = radius / GUIDED.window_sigmas
            if len(point) < GUIDED.min_matches:
                return None
        pose = self._problem(point, feature, noise * focal).refine(pose)
        tight, ratio = GUIDED.tight * focal, GUIDED.ratio
        point, feature = self.match(pose, tight, ratio)
        chance = [len(self.match(pose, tight, ratio, focal * beside)[0]) for beside in _BESIDE]
        return GuidedPose(pose, point, feature, max(chance), self.expected.sigmas_of(pose))

    def _problem(self, point: Indices, feature: Indices, noise_px: float) -> PoseProblem:
        xyz = self.known.xyz[point]
        return PoseProblem(xyz, self.pixels[feature], self.camera, noise_px, self.expected)


def _axes_px(
    known: KnownPoints, chosen: Indices, camera: pycolmap.Camera, camera_from_model: RigidTransform
) -> Array:
    """The axes [O, 2] in px that observations would have in another camera, without lens distortion."""
    at = camera_from_model.apply(known.xyz[known.point[chosen]])
    along = known.axes[chosen] @ camera_from_model.rotation.T
    depth = np.maximum(at[:, 2:], 1e-9)
    flat = (along[:, :2] - along[:, 2:] * at[:, :2] / depth) / depth
    length = np.linalg.norm(known.axes[chosen], axis=1, keepdims=True) / depth
    return np.asarray(camera.mean_focal_length() * flat / _lengths(flat) * length)


def _alike(expected: Array, axes: Array) -> NDArray[np.bool_]:
    """Which ``axes`` [N, 2] have about the expected direction and length."""
    lengths = _lengths(expected)[:, 0], _lengths(axes)[:, 0]
    cosines = (expected * axes).sum(axis=1) / (lengths[0] * lengths[1])
    octaves = np.abs(np.log2(lengths[1] / lengths[0]))
    return np.asarray((cosines > np.cos(np.radians(GUIDED.max_turn_deg))) & (octaves < GUIDED.max_octaves))


def _turns(first: Array, second: Array) -> Array:
    """The smallest rotations [N, 3, 3] that take the directions ``first`` [N, 3] to ``second``."""
    across = np.cross(first, second)
    cosine = np.maximum((first * second).sum(axis=1), -0.999)
    cross = np.zeros((len(first), 3, 3))
    x, y, z = across.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= np.swapaxes(cross, 1, 2)
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine)[:, None, None])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / _lengths(vectors))


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
