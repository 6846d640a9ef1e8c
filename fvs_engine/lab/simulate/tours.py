"""Camera paths through the synthetic scenes."""

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform, look_at

_HEIGHT_M, _TARGET_HEIGHT_M = 1.3, 0.5
"""Mean height of tours of a courtyard, and the height that an orbit looks at."""
_SURVEY_HEIGHT_M, _ALONG_M, _ACROSS_M = 30.0, 7.0, 8.0
"""Height of a survey, and its distances in a row and between rows."""


def orbit(count: int, radius_m: float = 3.0, turns: float = 1.0) -> list[RigidTransform]:
    """``count`` world_from_camera poses on circles around the origin that look at the z axis.

    The height sways by a fifth so that the centres do not lie in one plane, where SfM's scale along
    the axis would be ill-determined. Raises ``InvalidInputError`` for less than one pose or no radius.
    """
    if count < 1 or radius_m <= 0:
        raise InvalidInputError("An orbit needs at least one pose and a radius.")
    poses = []
    for angle in 2.0 * np.pi * turns * np.arange(count) / count:
        height = _HEIGHT_M * (1.0 + 0.2 * np.sin(3.0 * angle))
        centre = [radius_m * np.cos(angle), radius_m * np.sin(angle), height]
        poses.append(look_at(centre, [0.0, 0.0, _TARGET_HEIGHT_M], [0.0, 0.0, 1.0]))
    return poses


def look_around(count: int, radius_m: float = 1.2, turns: float = 1.0) -> list[RigidTransform]:
    """``count`` world_from_camera poses on circles around the origin that look level away from it.

    The height sways as that of ``orbit``. Raises ``InvalidInputError`` for less than one pose or no radius.
    """
    if count < 1 or radius_m <= 0:
        raise InvalidInputError("A tour needs at least one pose and a radius.")
    poses = []
    for angle in 2.0 * np.pi * turns * np.arange(count) / count:
        outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
        centre = radius_m * outwards + [0.0, 0.0, _HEIGHT_M * (1.0 + 0.2 * np.sin(3.0 * angle))]
        poses.append(look_at(centre, centre + outwards, [0.0, 0.0, 1.0]))
    return poses


def survey(count: int, seed: int = 0) -> list[RigidTransform]:
    """``count`` world_from_camera poses in parallel rows above the origin, flown to and fro, looking down.

    Wind moves and tilts the cameras: heights by 3 %, directions by 3°. Raises ``InvalidInputError`` for less
    than one pose.
    """
    if count < 1:
        raise InvalidInputError("A survey needs at least one pose.")
    generator = np.random.default_rng(seed)
    rows = max(1, round(np.sqrt(0.5 * count)))
    columns = -(-count // rows)
    poses = []
    for number in range(count):
        row, step = divmod(number, columns)
        column = step if row % 2 == 0 else columns - 1 - step
        x, y = _ALONG_M * (column - 0.5 * (columns - 1)), _ACROSS_M * (row - 0.5 * (rows - 1))
        centre = np.array([x, y, _SURVEY_HEIGHT_M * (1.0 + 0.03 * generator.standard_normal())])
        tilt = np.radians(3.0) * _SURVEY_HEIGHT_M * generator.standard_normal(2)
        poses.append(look_at(centre, [x + tilt[0], y + tilt[1], 0.0], [0.0, 1.0, 0.0]))
    return poses
