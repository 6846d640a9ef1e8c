"""Validation of arrays and rotations, for the constructors of this package."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_schema.quantities import MAX_COORDINATE

ORTHONORMAL_TOLERANCE = 1e-4
"""Largest entry of |R Rᵀ − I| that still counts as rounding (files often hold float32)."""

_FEW = 16

MAX_POSITION = MAX_COORDINATE / 10
"""Largest coordinate of a given position: after any rotation it is below ``MAX_COORDINATE``."""


def finite_array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``values`` as float64 of exactly ``shape``; ``InvalidInputError`` if it is not, or not finite."""
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise InvalidInputError(f"{name} must have shape {shape}, not {array.shape}.")
    # In plain numbers where they are few: numpy takes three times as long.
    finite = all(map(math.isfinite, array.flat)) if array.size <= _FEW else np.isfinite(array).all()
    if not finite:
        raise InvalidInputError(f"{name} has a number that is not finite.")
    return array


def rotation_matrix(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """``values`` as a proper rotation [3, 3]; ``InvalidInputError`` if it is a mirror, sheared or scaled."""
    matrix = finite_array(name, values, (3, 3))
    # In plain numbers here too: ten times as fast.
    x, y, z = matrix.tolist()
    products = (_dot(x, x) - 1, _dot(y, y) - 1, _dot(z, z) - 1, _dot(x, y), _dot(x, z), _dot(y, z))
    if max(map(abs, products)) > ORTHONORMAL_TOLERANCE:
        raise InvalidInputError(
            f"{name} is not orthonormal.", hint="A transform with scale is a SimilarityTransform."
        )
    if _dot(x, cross(y, z)) < 0:
        raise InvalidInputError(f"{name} is a reflection.", hint="Check the handedness of the axes.")
    return matrix


def rotation_matrices(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """``values`` as proper rotations [N, 3, 3]; raises as ``rotation_matrix``."""
    matrices = finite_array(name, values, (len(np.asarray(values)), 3, 3))
    deviations = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    proper = (deviations <= ORTHONORMAL_TOLERANCE) & (np.linalg.det(matrices) > 0)
    for number in np.flatnonzero(~proper):
        rotation_matrix(f"{name}[{number}]", matrices[number])
    return matrices


def cross(
    a: Sequence[float] | NDArray[np.float64], b: Sequence[float] | NDArray[np.float64]
) -> tuple[Any, Any, Any]:
    """The cross product a × b of two vectors [3] in plain numbers, or of arrays [3, N]; x, y and z."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def points_array(name: str, values: ArrayLike, dimensions: int) -> NDArray[np.float64]:
    """``values`` as float64 [..., dimensions]; not checked for finiteness."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != dimensions:
        raise InvalidInputError(f"{name} must have shape [..., {dimensions}], not {list(array.shape)}.")
    return array


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
