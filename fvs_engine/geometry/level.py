"""Level axes: a basis whose third direction is up."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.validation import finite_array


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
