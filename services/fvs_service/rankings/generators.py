"""Generators of candidate poses, in the world frame."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform, halfway_between_neighbours, look_at_from_each
from fvs_schema.candidates import AroundCurrent, Dataset, Grid, Orbit
from fvs_service.errors import InvalidRequestError
from fvs_service.rankings.scene_geometry import SceneGeometry

Array = NDArray[np.float64]
Candidates = dict[str, RigidTransform]
FromImages: TypeAlias = Orbit | Grid | Dataset | AroundCurrent
"""Generators that need the poses of images only; ``InVolume`` needs the model, which a runner has."""

_GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))


def generate(
    generator: FromImages,
    scene: SceneGeometry,
    current: Array | None,
    radius: float | None,
) -> Candidates:
    """The generator's poses: id → world_from_camera. Raises ``InvalidRequestError`` if there are none."""
    match generator:
        case Orbit():
            found = _orbit(generator, scene)
        case Grid():
            found = _grid(generator, scene)
        case Dataset():
            found = _between(scene)
        case AroundCurrent():
            if current is None or radius is None:
                raise InvalidRequestError(
                    "around-current needs current_pose and radius_m.",
                    hint="Send both, or choose another generator.",
                )
            found = _ball(generator, scene, current, radius)
    if not found:
        raise InvalidRequestError(
            "The generator finds no pose for the images that the scene has so far.",
            hint="Change the generator's options, choose another one, or add images and run an update.",
        )
    return found


def _orbit(orbit: Orbit, scene: SceneGeometry) -> Candidates:
    centre = scene.centre if orbit.centre is None else np.array(orbit.centre)
    offsets = (scene.centres - centre) @ scene.level
    radius = orbit.radius_m or float(np.median(np.hypot(offsets[:, 0], offsets[:, 1])))
    height = float(np.median(offsets[:, 2])) if orbit.height_m is None else orbit.height_m
    angles = np.arange(orbit.count) * (2.0 * np.pi / orbit.count)
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(orbit.count, height)])
    return _looking_at("orbit", centre + ring @ scene.level.T, centre, scene.up)


def _grid(grid: Grid, scene: SceneGeometry) -> Candidates:
    heights = (scene.centres - scene.centre) @ scene.up
    height = float(heights.max()) if grid.height_m is None else grid.height_m
    middle = scene.centre @ scene.level
    x = _spread(scene.lower[0] - grid.margin_m, scene.upper[0] + grid.margin_m, grid.columns)
    y = _spread(scene.lower[1] - grid.margin_m, scene.upper[1] + grid.margin_m, grid.rows)
    level = np.array([[across, along, middle[2] + height] for along in y for across in x])
    positions = level @ scene.level.T
    if grid.look == "centre":
        return _looking_at("grid", positions, scene.centre, scene.up)
    # Straight down, the images are upright towards the second level direction (north, in an ENU world).
    return _looking_at("grid", positions, positions - scene.up, scene.level[:, 1])


def _between(scene: SceneGeometry) -> Candidates:
    return {
        f"between-{first:04d}-{second:04d}": pose
        for (first, second), pose in halfway_between_neighbours(scene.cameras).items()
    }


def _ball(generator: AroundCurrent, scene: SceneGeometry, current: Array, radius: float) -> Candidates:
    """Poses on a Fibonacci spiral in a ball, so that each has an equal share of its volume."""
    index = np.arange(generator.count) + 0.5
    z = 1.0 - 2.0 * ((index * 0.754877666) % 1.0)
    angles = index * _GOLDEN_ANGLE_RAD
    ring = np.sqrt(1.0 - z**2)
    directions = np.column_stack([ring * np.cos(angles), ring * np.sin(angles), z])
    positions = current + radius * np.cbrt(index / generator.count)[:, None] * directions @ scene.level.T
    return _looking_at("around", positions, scene.centre, scene.up)


def _looking_at(prefix: str, positions: Array, targets: Array, up: Array) -> Candidates:
    """Poses at ``positions`` but those that are their own target: they have no viewing direction."""
    cameras = look_at_from_each(positions, targets, up)
    return {f"{prefix}-{number:04d}": camera for number, camera in enumerate(cameras) if camera is not None}


def _spread(lower: float, upper: float, count: int) -> Array:
    """The centres of ``count`` equal parts of an interval."""
    return lower + (upper - lower) * (np.arange(count) + 0.5) / count
