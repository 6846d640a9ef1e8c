"""Cameras between given ones: halfway between neighbours, and a smooth path through many."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.rotations import angle_between, matrix_from_quaternion, quaternion_from_matrix
from fvs_engine.geometry.transforms import RigidTransform

_NEIGHBOURS = 2


def halfway_between_neighbours(
    model_from_cameras: Sequence[RigidTransform],
) -> dict[tuple[int, int], RigidTransform]:
    """Cameras halfway between each camera and its two nearest neighbours, by the pair's sorted indices.

    A position is the middle of the pair's positions, a rotation is halfway along the shorter arc.
    """
    from scipy.spatial import KDTree  # slow to import

    if len(model_from_cameras) < 2:
        return {}
    centres = np.stack([camera.translation for camera in model_from_cameras])
    _, nearest = KDTree(centres).query(centres, k=min(_NEIGHBOURS + 1, len(centres)))
    pairs: set[tuple[int, int]] = set()
    for index, near in enumerate(nearest.tolist()):
        for other in [number for number in near if number != index][:_NEIGHBOURS]:
            pairs.add((min(index, other), max(index, other)))
    ordered = sorted(pairs)
    first, second = np.array(ordered).T
    quaternions = quaternion_from_matrix(np.stack([camera.rotation for camera in model_from_cameras]))
    # The rotation halfway along the shorter arc is the sum of the unit quaternions with equal signs.
    nearer = np.where(np.sum(quaternions[first] * quaternions[second], axis=1, keepdims=True) < 0, -1.0, 1.0)
    rotations = matrix_from_quaternion(quaternions[first] + nearer * quaternions[second])
    middles = 0.5 * (centres[first] + centres[second])
    return dict(zip(ordered, map(RigidTransform, rotations, middles), strict=True))


def smooth_path(model_from_cameras: Sequence[RigidTransform], count: int) -> tuple[RigidTransform, ...]:
    """``count`` cameras along a smooth path through the given ones, in their order, at a nearly even pace.

    Centres follow a natural cubic spline, rotations scipy's C² rotation spline, both over the length
    travelled (distance as a share of the path's extent, plus turns as a share of π). The first and the last
    camera are met exactly. Raises ``InvalidInputError`` without cameras or for ``count`` < 1.
    """
    from scipy.interpolate import CubicSpline  # slow to import, as are rotations
    from scipy.spatial.transform import Rotation, RotationSpline

    if not model_from_cameras or count < 1:
        raise InvalidInputError("A path needs at least one camera to pass through and one to return.")
    keys = _without_repeats(model_from_cameras)
    if len(keys) == 1:
        return (keys[0],) * count
    times = np.concatenate([[0.0], np.cumsum(_steps(keys))])
    samples = np.linspace(0.0, times[-1], count)
    centres = CubicSpline(times, np.stack([key.translation for key in keys]), bc_type="natural")(samples)
    turns = RotationSpline(times, Rotation.from_matrix(np.stack([key.rotation for key in keys])))
    return tuple(map(RigidTransform, turns(samples).as_matrix(), centres))


def _steps(keys: Sequence[RigidTransform]) -> np.ndarray:
    """The distance from each camera to the next, in a measure of both movement and rotation."""
    centres = np.stack([key.translation for key in keys])
    rotations = np.stack([key.rotation for key in keys])
    extent = np.ptp(centres, axis=0).max()
    distances = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    shares = distances / extent if extent > 0 else np.zeros_like(distances)
    return np.asarray(shares + angle_between(rotations[:-1], rotations[1:]) / np.pi)


def _without_repeats(cameras: Sequence[RigidTransform]) -> list[RigidTransform]:
    """Drop cameras that repeat the pose before them: a spline cannot pause."""
    keys = [cameras[0]]
    for camera in cameras[1:]:
        moved = np.linalg.norm(camera.translation - keys[-1].translation)
        turned = angle_between(camera.rotation, keys[-1].rotation)
        if moved > 1e-9 * (1.0 + np.abs(camera.translation).max()) or turned > 1e-9:
            keys.append(camera)
    return keys
