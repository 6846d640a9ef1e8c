"""Look-at poses, and the camera axes of OpenGL."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.transforms import RigidTransform
from fvs_engine.geometry.validation import cross, finite_array

OPENGL_FROM_OPENCV = RigidTransform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""Our camera axes (x right, y down, z forward) to those of OpenGL, Blender and NeRF (y up, z backward).

``model_from_camera = model_from_opengl_camera @ OPENGL_FROM_OPENCV``. It is its own inverse.
"""


def look_at(centre: ArrayLike, target: ArrayLike, up: ArrayLike) -> RigidTransform:
    """The model_from_camera of a level camera at ``centre`` [3] that looks at ``target`` [3].

    ``up`` [3] points up in the image. Looking straight along it, the axis of the model that is most nearly
    upright in the image replaces it. Raises ``InvalidInputError`` when ``target`` is the centre, ``up``
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


def _divided(vector: Sequence[float], by: float) -> tuple[float, float, float]:
    return vector[0] / by, vector[1] / by, vector[2] / by
