"""The pose of an image from the points that it sees and its expected pose, both with errors."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.rotations import matrix_from_rotation_vector
from fvs_engine.sfm.native.thresholds import POSES
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.prior_frame import PriorFrame, is_vague

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ExpectedPose:
    """The pose in the model that a prior predicts, with standard deviations per coordinate and per axis.

    The position's is in the model's unit, that of the orientation in rad.
    """

    camera_from_model: RigidTransform
    position_sigma: float
    orientation_sigma: float

    @staticmethod
    def of(prior: PosePrior, priors: PosePriors, frame: PriorFrame) -> "ExpectedPose | None":
        """The expected pose in the model of the ``frame``; None without an orientation, and for a vague one.

        An error of the alignment has most effect outside the region of the aligned positions. A prior is no
        more accurate than those of registered images have been.
        """
        world_from_camera = prior.world_from_camera
        if world_from_camera is None or not frame.oriented or is_vague(prior, priors, frame):
            return None
        world = priors.positions(list(frame.aligned))
        away = ((world - world.mean(axis=0)) ** 2).sum()
        outside = ((np.array(prior.position) - world.mean(axis=0)) ** 2).sum() / away
        spread = np.sqrt(away / len(world))
        noise = max(prior.position_sigma, frame.position_noise)
        sigma = noise * np.sqrt(1.0 + 1.0 / len(world) + outside)
        least = POSES.min_prior_position_share * spread
        turned_deg = max(
            prior.orientation_sigma_deg, frame.orientation_noise_deg, POSES.min_prior_orientation_deg
        )
        model_from_world = frame.world_from_model.inverse()
        return ExpectedPose(
            model_from_world.move_camera(world_from_camera).inverse(),
            float(max(sigma, least)) * model_from_world.scale,
            float(np.radians(turned_deg)),
        )

    @property
    def centre(self) -> Array:
        """The expected camera centre [3]."""
        return self.camera_from_model.inverse().translation

    def sigmas_of(self, camera_from_model: RigidTransform) -> float:
        """How far a pose is from this one, in standard deviations: in position or orientation."""
        shift = np.linalg.norm(camera_from_model.inverse().translation - self.centre)
        turn = rotation_vector(camera_from_model.rotation @ self.camera_from_model.rotation.T)
        turned = np.linalg.norm(turn) / self.orientation_sigma
        return float(max(shift / self.position_sigma, turned))

    def turned(self, rotation: Array) -> RigidTransform:
        """camera_from_model of the camera rotated in place by a rotation [3, 3]."""
        turned = rotation @ self.camera_from_model.rotation
        return RigidTransform(turned, -turned @ self.centre)


def expected_poses(
    names: Iterable[str], priors: PosePriors, frame: PriorFrame | None
) -> dict[str, ExpectedPose]:
    """Those of the images ``names`` that priors predict; none without a ``frame``."""
    if frame is None:
        return {}
    poses = {
        name: ExpectedPose.of(priors.by_name[name], priors, frame) for name in names if name in priors.by_name
    }
    return {name: pose for name, pose in poses.items() if pose is not None}


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """The data that determine the pose of an image: points that it sees, and its expected pose, if any.

    ``pixels`` [N, 2] are the observations of ``points`` [N, 3], with the standard deviation ``noise_px`` per
    coordinate.
    """

    points: Array
    pixels: Array
    camera: pycolmap.Camera
    noise_px: float
    expected: ExpectedPose | None = None

    def of(self, which: NDArray[np.bool_]) -> "PoseProblem":
        """The same with some of the points."""
        return replace(self, points=self.points[which], pixels=self.pixels[which])

    def refine(self, camera_from_model: RigidTransform) -> RigidTransform:
        """Refine ``camera_from_model`` by the errors of the points and the deviation from the prior.

        Points and priors that are off by more than three standard deviations are down-weighted (Cauchy's
        loss).
        """
        focal = float(self.camera.mean_focal_length())
        seen = np.asarray(self.camera.cam_from_img(self.pixels)).reshape(-1, 2)
        expected = self.expected
        rotation, centre = camera_from_model.rotation, camera_from_model.inverse().translation
        for _ in range(POSES.iterations):
            local = (self.points - centre) @ rotation.T
            ahead = local[:, 2] > 1e-9
            x, y, z = local[ahead].T
            unit = focal / self.noise_px
            errors = unit * (np.stack([x / z, y / z], axis=1) - seen[ahead])
            weights = 1.0 / (1.0 + (errors**2).sum(axis=1) / POSES.doubted_sigmas**2)
            zero = np.zeros_like(z)
            by_local = (unit / z)[:, None, None] * np.stack(
                [np.stack([zero + 1, zero, -x / z], axis=1), np.stack([zero, zero + 1, -y / z], axis=1)],
                axis=1,
            )
            by_turn = -np.einsum("nij,njk->nik", by_local, _cross(local[ahead]))
            by_shift = -by_local @ rotation
            slopes = np.concatenate([by_turn, by_shift], axis=2)
            normal = np.einsum("n,nij,nik->jk", weights, slopes, slopes)
            gradient = np.einsum("n,nij,ni->j", weights, slopes, errors)
            if expected is not None:
                turned = rotation_vector(rotation @ expected.camera_from_model.rotation.T)
                turn_error = turned / expected.orientation_sigma
                shift_error = (centre - expected.centre) / expected.position_sigma
                for error, sigma, part in (
                    (turn_error, expected.orientation_sigma, slice(0, 3)),
                    (shift_error, expected.position_sigma, slice(3, 6)),
                ):
                    weight = 1.0 / (1.0 + float(error @ error) / POSES.doubted_sigmas**2)
                    normal[part, part] += weight / sigma**2 * np.eye(3)
                    gradient[part] += weight / sigma * error
            scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
            step = -np.linalg.solve(
                normal / np.outer(scale, scale) + POSES.damping * np.eye(6), gradient / scale
            )
            step /= scale
            rotation = matrix_from_rotation_vector(step[:3]) @ rotation
            centre = centre + step[3:]
            if float(np.linalg.norm(scale * step)) < 1e-3:
                break
        return RigidTransform(rotation, -rotation @ centre)

    def cost(self, camera_from_model: RigidTransform) -> float:
        """The sum that ``refine`` minimises: Cauchy's losses of points and prior, divided by 9 / 2.

        A point behind the camera counts as one far off.
        """
        pixel, depth = project(self.camera, camera_from_model, self.points)
        squares = np.full(len(self.points), POSES.behind)
        ahead = (depth > 1e-9) & np.isfinite(pixel).all(axis=1)
        squares[ahead] = ((pixel[ahead] - self.pixels[ahead]) ** 2).sum(axis=1) / self.noise_px**2
        expected = self.expected
        if expected is not None:
            turn = rotation_vector(camera_from_model.rotation @ expected.camera_from_model.rotation.T)
            shift = camera_from_model.inverse().translation - expected.centre
            deviations = (turn / expected.orientation_sigma, shift / expected.position_sigma)
            squares = np.append(squares, [float(error @ error) for error in deviations])
        return float(np.log1p(squares / POSES.doubted_sigmas**2).sum())


def project(camera: pycolmap.Camera, camera_from_model: RigidTransform, points: Array) -> tuple[Array, Array]:
    """Project points [P, 3] to px [P, 2], with their depths [P]; those behind the camera have no position."""
    local = camera_from_model.apply(points)
    pixels = np.full((len(points), 2), np.inf)
    ahead = local[:, 2] > 1e-9
    if ahead.any():
        pixels[ahead] = np.asarray(camera.img_from_cam(local[ahead]))
    return pixels, local[:, 2]


def rotation_vector(rotation: Array) -> Array:
    """The rotation vector [3] of a rotation [3, 3] of less than half a turn."""
    skew = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = 0.5 * float(np.linalg.norm(skew))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    return np.asarray(skew * (0.5 if sine < 1e-12 else 0.5 * angle / sine))


def _cross(vectors: Array) -> Array:
    """The matrices [N, 3, 3] of the cross products with ``vectors`` [N, 3]."""
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -z, y, -x
    return matrices - np.swapaxes(matrices, 1, 2)
