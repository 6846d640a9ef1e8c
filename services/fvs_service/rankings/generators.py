"""Candidate poses for whoever has none, in the world's frame."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform, look_at, matrix_from_quaternion, quaternion_from_matrix
from fvs_service.errors import InvalidRequestError
from fvs_service.rankings.model import AroundCurrent, Dataset, Grid, Orbit

Array = NDArray[np.float64]
Candidates = dict[str, RigidTransform]

_NEIGHBOURS = 2
_GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What a generator may know, in the world's frame: the registered cameras and what they look at.

    ``cameras`` are world_from_camera; ``lower`` and ``upper`` are corners of a box about the model's points
    in the frame of ``level`` [3, 3], whose columns are two level directions and ``up``.
    """

    cameras: tuple[RigidTransform, ...]
    centre: Array
    level: Array
    lower: Array
    upper: Array

    @property
    def up(self) -> Array:
        """The upward direction [3]."""
        return np.asarray(self.level[:, 2])

    @cached_property
    def places(self) -> KDTree:
        """Where the cameras are, to be searched for the nearest."""
        return KDTree(np.stack([camera.translation for camera in self.cameras]))

    @property
    def centres(self) -> Array:
        """Where the cameras are [N, 3]."""
        return np.asarray(self.places.data)


def generate(
    generator: Orbit | Grid | Dataset | AroundCurrent,
    around: Surroundings,
    current: Array | None,
    radius: float | None,
) -> Candidates:
    """Its poses: id → world_from_camera. Raises ``InvalidRequestError`` if there are none."""
    match generator:
        case Orbit():
            found = _orbit(generator, around)
        case Grid():
            found = _grid(generator, around)
        case Dataset():
            found = _between(around)
        case AroundCurrent():
            if current is None or radius is None:
                raise InvalidRequestError("around-current needs current_pose and radius_m.")
            found = _ball(generator, around, current, radius)
    if not found:
        raise InvalidRequestError("The generator makes no pose of what the scene has so far.")
    return found


def _orbit(orbit: Orbit, around: Surroundings) -> Candidates:
    centre = around.centre if orbit.centre is None else np.array(orbit.centre)
    offsets = (around.centres - centre) @ around.level
    radius = orbit.radius_m or float(np.median(np.hypot(offsets[:, 0], offsets[:, 1])))
    height = float(np.median(offsets[:, 2])) if orbit.height_m is None else orbit.height_m
    angles = np.arange(orbit.count) * (2.0 * np.pi / orbit.count)
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(orbit.count, height)])
    return _looking("orbit", centre + ring @ around.level.T, lambda _place: centre, around.up)


def _grid(grid: Grid, around: Surroundings) -> Candidates:
    heights = (around.centres - around.centre) @ around.up
    height = float(heights.max()) if grid.height_m is None else grid.height_m
    middle = around.centre @ around.level
    x = _spread(around.lower[0], around.upper[0], grid.columns)
    y = _spread(around.lower[1], around.upper[1], grid.rows)
    level = np.array([[across, along, middle[2] + height] for along in y for across in x])
    if grid.look == "centre":
        return _looking("grid", level @ around.level.T, lambda _place: around.centre, around.up)
    # Straight down, the images are upright towards the second level direction (north, in an ENU world).
    return _looking("grid", level @ around.level.T, lambda place: place - around.up, around.level[:, 1])


def _between(around: Surroundings) -> Candidates:
    centres = around.centres
    if len(centres) < 2:
        return {}
    _, nearest = around.places.query(centres, k=min(_NEIGHBOURS + 1, len(centres)))
    pairs: set[tuple[int, int]] = set()
    for index, near in enumerate(nearest.tolist()):
        for other in [number for number in near if number != index][:_NEIGHBOURS]:
            pairs.add((min(index, other), max(index, other)))
    first, second = np.array(sorted(pairs)).T
    turns = quaternion_from_matrix(np.stack([camera.rotation for camera in around.cameras]))
    # Half-way, the short way, is along the sum of the two unit quaternions, of ±q the nearer one.
    nearer = np.where(np.sum(turns[first] * turns[second], axis=1, keepdims=True) < 0, -1.0, 1.0)
    rotations = matrix_from_quaternion(turns[first] + nearer * turns[second])
    names = [f"between-{one:04d}-{other:04d}" for one, other in zip(first, second, strict=True)]
    middles = 0.5 * (centres[first] + centres[second])
    return dict(zip(names, map(RigidTransform, rotations, middles), strict=True))


def _ball(generator: AroundCurrent, around: Surroundings, current: Array, radius: float) -> Candidates:
    """A Fibonacci spiral whose radius grows so that every pose has the same share of the ball."""
    index = np.arange(generator.count) + 0.5
    z = 1.0 - 2.0 * ((index * 0.754877666) % 1.0)
    angles = index * _GOLDEN_ANGLE_RAD
    ring = np.sqrt(1.0 - z**2)
    directions = np.column_stack([ring * np.cos(angles), ring * np.sin(angles), z])
    places = current + radius * np.cbrt(index / generator.count)[:, None] * directions @ around.level.T
    return _looking("around", places, lambda _place: around.centre, around.up)


def _looking(prefix: str, places: Array, target: Callable[[Array], Array], up: Array) -> Candidates:
    found = {}
    for number, place in enumerate(places):
        try:
            found[f"{prefix}-{number:04d}"] = look_at(place, target(place), up)
        except InvalidInputError:  # it stands where it should look
            continue
    return found


def _spread(lower: float, upper: float, count: int) -> Array:
    """``count`` places in the middle of equal parts."""
    return lower + (upper - lower) * (np.arange(count) + 0.5) / count
