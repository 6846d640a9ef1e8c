"""Look-at poses, and the camera axes of OpenGL."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    (camera,) = look_at_from_each(np.asarray(centre)[None], target, up)
    if camera is None:
        raise InvalidInputError("A camera cannot look at its own centre.")
    return camera


def look_at_from_each(
    centres: ArrayLike, targets: ArrayLike, up: ArrayLike
) -> tuple[RigidTransform | None, ...]:
    """``look_at`` from each of ``centres`` [N, 3] at ``targets``, [N, 3] or one [3] for all.

    They are computed together, which takes a fraction of the time. None where the target is the centre.
    """
    origins = finite_array("centres", centres, (len(np.asarray(centres)), 3))
    aims = finite_array("targets", targets, (3,) if np.ndim(targets) == 1 else origins.shape)
    upwards = finite_array("up", up, (3,))
    height = np.linalg.norm(upwards)
    if height == 0:
        raise InvalidInputError("The up vector is zero.")
    forward = aims - origins
    distances = np.linalg.norm(forward, axis=1)
    seen = distances > 1e-12 * np.abs(origins).max(axis=1, initial=0.0)
    z = (forward[seen] / distances[seen, None]).T
    x = np.array(cross(z, upwards / height))
    along = np.linalg.norm(x, axis=0) < 1e-6
    if along.any():
        x[:, along] = cross(z[:, along], np.eye(3)[:, np.argmin(np.abs(z[:, along]), axis=0)])
    x /= np.linalg.norm(x, axis=0)
    cameras = iter(RigidTransform.many(np.array([x, cross(z, x), z]).transpose(2, 1, 0), origins[seen]))
    return tuple(next(cameras) if one else None for one in seen.tolist())


def level_axes(up: ArrayLike) -> NDArray[np.float64]:
    """The columns x, y and up [3, 3] of a right-handed basis; with z up they are east, north and up.

    Raises ``InvalidInputError`` when ``up`` [3] is zero or not finite.
    """
    vector = finite_array("up", up, (3,))
    height = np.linalg.norm(vector)
    if height == 0:
        raise InvalidInputError("The up vector is zero.")
    z = vector / height
    start = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = start - z * (start @ z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
