"""Camera paths through the synthetic scenes."""

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


def look_around(
    count: int, radius_m: float = 1.2, height_m: float = 1.3, turns: float = 1.0
) -> list[RigidTransform]:
    """``count`` world_from_camera poses on circles around the origin that look level away from it.

    The height sways as that of ``orbit``. Raises ``InvalidInputError`` for less than one pose or no radius.
    """
    if count < 1 or radius_m <= 0:
        raise InvalidInputError("A tour needs at least one pose and a radius.")
    poses = []
    for angle in 2.0 * np.pi * turns * np.arange(count) / count:
        outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
        centre = radius_m * outwards + [0.0, 0.0, height_m * (1.0 + 0.2 * np.sin(3.0 * angle))]
        poses.append(look_at(centre, centre + outwards, [0.0, 0.0, 1.0]))
    return poses


def survey(
    count: int, height_m: float = 30.0, along_m: float = 7.0, across_m: float = 8.0, seed: int = 0
) -> list[RigidTransform]:
    """``count`` world_from_camera poses in parallel rows above the origin, flown to and fro, looking down.

    Wind moves and tilts the cameras: heights by 3 %, directions by 3°. Raises ``InvalidInputError`` for less
    than one pose, or no height or distance.
    """
    if count < 1 or min(height_m, along_m, across_m) <= 0:
        raise InvalidInputError("A survey needs at least one pose, a height and distances.")
    generator = np.random.default_rng(seed)
    rows = max(1, round(np.sqrt(0.5 * count)))
    columns = -(-count // rows)
    poses = []
    for number in range(count):
        row, step = divmod(number, columns)
        column = step if row % 2 == 0 else columns - 1 - step
        x, y = along_m * (column - 0.5 * (columns - 1)), across_m * (row - 0.5 * (rows - 1))
        centre = np.array([x, y, height_m * (1.0 + 0.03 * generator.standard_normal())])
        tilt = np.radians(3.0) * height_m * generator.standard_normal(2)
        poses.append(look_at(centre, [x + tilt[0], y + tilt[1], 0.0], [0.0, 1.0, 0.0]))
    return poses
