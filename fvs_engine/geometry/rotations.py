"""Rotations as unit quaternions ``wxyz`` and as matrices [3, 3]."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.validation import points_array

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def matrix_from_quaternion(quaternion_wxyz: ArrayLike) -> Array:
    """Rotation matrices [..., 3, 3] of quaternions [..., 4] of any length but zero.

    Raises ``InvalidInputError`` for a quaternion that is zero or not finite.
    """
    return np.asarray(_rotation(quaternion_wxyz).as_matrix())


def quaternion_from_matrix(rotation: ArrayLike) -> Array:
    """Unit quaternions wxyz [..., 4] of rotation matrices [..., 3, 3]; of ±q, the one with w ≥ 0.

    A matrix that is a rotation but for rounding gives its nearest rotation. Raises ``InvalidInputError`` for
    a matrix that is singular, a reflection or not finite.
    """
    matrix = np.asarray(rotation, dtype=np.float64)
    if matrix.shape[-2:] != (3, 3):
        raise InvalidInputError(f"Rotations must have shape [..., 3, 3], not {list(matrix.shape)}.")
    if not np.isfinite(matrix).all() or (np.linalg.det(matrix) <= 0).any():
        raise InvalidInputError("A rotation matrix is singular, a reflection or not finite.")
    flat = _scipy().from_matrix(matrix.reshape(-1, 3, 3))
    return np.asarray(flat.as_quat(canonical=True, scalar_first=True).reshape(*matrix.shape[:-2], 4))


def matrix_from_rotation_vector(rotation_vector: ArrayLike) -> Array:
    """The rotation matrix [3, 3] of a turn about an axis: its direction, by its length in rad."""
    return np.asarray(_scipy().from_rotvec(np.asarray(rotation_vector, dtype=np.float64)).as_matrix())


def angle_between(first: ArrayLike, second: ArrayLike) -> Array:
    """Angle in rad, 0 to π, of the turn from one rotation matrix to another, each [..., 3, 3]."""
    turn = np.swapaxes(np.asarray(first, dtype=np.float64), -2, -1) @ np.asarray(second, dtype=np.float64)
    flat = _scipy().from_matrix(turn.reshape(-1, 3, 3))
    return np.asarray(flat.magnitude().reshape(turn.shape[:-2]))


def _rotation(quaternion_wxyz: ArrayLike) -> "Rotation":
    quaternion = points_array("quaternion_wxyz", quaternion_wxyz, 4)
    if not np.isfinite(quaternion).all() or (np.linalg.norm(quaternion, axis=-1) < 1e-150).any():
        raise InvalidInputError("A quaternion is zero or not finite.")
    return _scipy().from_quat(quaternion, scalar_first=True)


def _scipy() -> Any:
    """Scipy's rotations, loaded when the first is needed: their import takes longer than all of ours."""
    from scipy.spatial.transform import Rotation

    return Rotation
