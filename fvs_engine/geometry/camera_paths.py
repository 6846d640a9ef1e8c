"""Where cameras stand and how they move: look-at, camera axes of other programs, paths through views."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, RotationSpline

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.rotations import (
    angle_between,
    matrix_from_quaternion,
    quaternion_from_matrix,
    slerp,
)
from fvs_engine.geometry.transforms import RigidTransform
from fvs_engine.geometry.validation import cross, finite_array

OPENGL_FROM_OPENCV = RigidTransform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""Our camera axes (x right, y down, z forward) to those of OpenGL, Blender and NeRF (y up, z backward).

``model_from_camera = model_from_opengl_camera @ OPENGL_FROM_OPENCV``. It is its own inverse.
"""


def look_at(centre: ArrayLike, target: ArrayLike, up: ArrayLike) -> RigidTransform:
    """The model_from_camera of a level camera at ``centre`` [3] that looks at ``target`` [3].

    ``up`` [3] points up in the image. Looking straight along it, the axis of the model that is most nearly
    upright in the image takes its place. Raises ``InvalidInputError`` when ``target`` is the centre, ``up``
    is zero or a number is not finite.
    """
    origin = finite_array("centre", centre, (3,))
    forward = (finite_array("target", target, (3,)) - origin).tolist()
    upwards = finite_array("up", up, (3,)).tolist()
    distance, height = math.hypot(*forward), math.hypot(*upwards)
    if distance <= 1e-12 * np.abs(origin).max() or distance == 0:
        raise InvalidInputError("A camera cannot look at its own centre.")
    if height == 0:
        raise InvalidInputError("The up vector is zero.")
    z = _divided(forward, distance)
    x = cross(z, _divided(upwards, height))
    if math.hypot(*x) < 1e-6:
        x = cross(z, np.eye(3)[np.argmin(np.abs(z))].tolist())
    x = _divided(x, math.hypot(*x))
    return RigidTransform(np.array([x, cross(z, x), z]).T, origin)


def interpolate(first: RigidTransform, second: RigidTransform, t: float) -> RigidTransform:
    """The model_from_camera ``t`` of the way between two: a straight line and a steady turn."""
    quaternions = quaternion_from_matrix(np.stack([first.rotation, second.rotation]))
    return RigidTransform(
        matrix_from_quaternion(slerp(quaternions[0], quaternions[1], t)),
        (1.0 - t) * first.translation + t * second.translation,
    )


def smooth_path(model_from_cameras: Sequence[RigidTransform], count: int) -> tuple[RigidTransform, ...]:
    """``count`` cameras along a smooth path through the given ones, in their order, at a nearly even pace.

    Centres follow a natural cubic spline, rotations scipy's C² rotation spline, both over the way
    travelled (distance as a share of the path's extent, plus turns as a share of π). The first and the last
    camera are met exactly. Raises ``InvalidInputError`` without cameras or for ``count`` < 1.
    """
    from scipy.interpolate import CubicSpline  # half of what importing this package would take

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


def _divided(vector: Sequence[float], by: float) -> tuple[float, float, float]:
    return vector[0] / by, vector[1] / by, vector[2] / by


def _steps(keys: Sequence[RigidTransform]) -> np.ndarray:
    """How far it is from each camera to the next, in a measure that sees both moves and turns."""
    centres = np.stack([key.translation for key in keys])
    rotations = np.stack([key.rotation for key in keys])
    extent = np.ptp(centres, axis=0).max()
    distances = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    shares = distances / extent if extent > 0 else np.zeros_like(distances)
    return np.asarray(shares + angle_between(rotations[:-1], rotations[1:]) / np.pi)


def _without_repeats(cameras: Sequence[RigidTransform]) -> list[RigidTransform]:
    """Drop cameras that stand where the one before stands: a spline cannot pause."""
    keys = [cameras[0]]
    for camera in cameras[1:]:
        moved = np.linalg.norm(camera.translation - keys[-1].translation)
        turned = angle_between(camera.rotation, keys[-1].rotation)
        if moved > 1e-9 * (1.0 + np.abs(camera.translation).max()) or turned > 1e-9:
            keys.append(camera)
    return keys
