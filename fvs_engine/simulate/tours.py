"""Camera paths around the synthetic scene."""

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform, look_at


def orbit(
    count: int, radius_m: float = 3.0, height_m: float = 1.3, target_height_m: float = 0.5, turns: float = 1.0
) -> list[RigidTransform]:
    """``count`` world_from_camera poses on circles around the origin that look at the z axis.

    The height sways by a fifth so that the centres do not lie in one plane, where SfM's scale along
    the axis would be ill-determined. Raises ``InvalidInputError`` for less than one pose or no radius.
    """
    if count < 1 or radius_m <= 0:
        raise InvalidInputError("An orbit needs at least one pose and a radius.")
    poses = []
    for angle in 2.0 * np.pi * turns * np.arange(count) / count:
        height = height_m * (1.0 + 0.2 * np.sin(3.0 * angle))
        centre = [radius_m * np.cos(angle), radius_m * np.sin(angle), height]
        poses.append(look_at(centre, [0.0, 0.0, target_height_m], [0.0, 0.0, 1.0]))
    return poses
