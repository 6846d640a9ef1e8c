"""Positions and the ground under them: by a terrain, and by sparse points."""

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, geodetic_coordinates
from fvs_engine.geometry.ground import GroundCheck, require_datum
from fvs_engine.geometry.ground_of_points import LEAST_POINTS, ground_of_points
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import NO_HEIGHT_M, Terrain

HOME = GeodeticPosition(46.0, 7.75, 500.0)


def _slope(level_m: np.ndarray) -> np.ndarray:
    """The ground of the made site [N], over east and north [N, 2]."""
    return np.asarray(0.2 * level_m[:, 0] - 0.1 * level_m[:, 1])


def _site(draw: np.random.Generator, count: int = 6_000) -> np.ndarray:
    """Points of a slope, ENU: two of five of them on trees, one of a hundred a mismatch far under it."""
    level_m = draw.uniform(-100.0, 100.0, (count, 2))
    level_m = level_m[np.hypot(*(level_m - [30.0, 0.0]).T) > 20.0]  # nothing matches on the pond
    up_m = _slope(level_m) + draw.normal(0.0, 0.05, len(level_m))
    up_m += np.where(draw.random(len(level_m)) < 0.4, draw.uniform(2.0, 15.0, len(level_m)), 0.0)
    up_m -= np.where(draw.random(len(level_m)) < 0.01, draw.uniform(5.0, 100.0, len(level_m)), 0.0)
    return np.column_stack([level_m, up_m])


def _ground_m(terrain: Terrain, position_m: np.ndarray, home: GeodeticPosition) -> float:
    """Up of ``home``, under a position [3]."""
    latitude, longitude, altitude = geodetic_coordinates(position_m[None], home)[0].tolist()
    ground_m = terrain.height_m((latitude, longitude))
    assert ground_m is not None
    return float(position_m[2] + ground_m - altitude)


@pytest.mark.parametrize(
    "home", [HOME, GeodeticPosition(-17.0, 179.9999, 500.0)], ids=["alps", "antimeridian"]
)
def test_the_ground_of_points_is_under_trees_and_over_mismatches(home: GeodeticPosition) -> None:
    points = _site(np.random.default_rng(0))
    terrain = ground_of_points(geodetic_coordinates(points, home), AltitudeDatum.ELLIPSOID)
    assert terrain.altitude_datum is AltitudeDatum.ELLIPSOID
    places = np.array([(east, north, 0.0) for east in range(-80, 81, 10) for north in range(-80, 81, 10)])
    off = [_ground_m(terrain, place, home) - _slope(place[None])[0] for place in places]
    assert np.abs(np.median(off)) < 0.3
    assert np.percentile(np.abs(off), 90) < 1.5
    assert np.abs(off).max() < 4.0
    assert terrain.height_m((home.latitude_deg + 0.01, home.longitude_deg)) is None


def test_points_of_a_facade_make_a_ground() -> None:
    draw = np.random.default_rng(1)
    wall = np.column_stack([draw.uniform(-20, 20, 500), np.zeros(500), draw.uniform(0, 10, 500)])
    terrain = ground_of_points(geodetic_coordinates(wall, HOME), AltitudeDatum.SEA_LEVEL)
    feet = [_ground_m(terrain, np.array([east, 0.0, 0.0]), HOME) for east in range(-15, 16)]
    assert np.median(feet) == pytest.approx(1.0, abs=1.0)


def test_too_few_points_make_none() -> None:
    few = np.tile([46.0, 7.75, 500.0], (LEAST_POINTS, 1))
    few[0, 2] = np.nan
    with pytest.raises(InvalidInputError, match="99 sparse points, too few"):
        ground_of_points(few, AltitudeDatum.SEA_LEVEL)


def _terrain(*heights_m: float) -> Terrain:
    return Terrain(
        south_deg=45.999,
        west_deg=7.749,
        latitude_step_deg=0.002,
        longitude_step_deg=0.001,
        columns=3,
        heights_m=heights_m * 2,
    )


def test_positions_are_under_the_ground_above_it_or_not_judged() -> None:
    positions_m = {
        "under": np.array([-30.0, 0.0, -0.1]),
        "above": np.array([-30.0, 0.0, 0.1]),
        "beside a hole": np.array([30.0, 0.0, -50.0]),
        "far": np.array([0.0, 5_000.0, -50.0]),
    }
    check = GroundCheck.of(positions_m, HOME, _terrain(500.0, 500.0, NO_HEIGHT_M))
    assert check == GroundCheck(("under",), ("beside a hole", "far"), 4)
    assert GroundCheck.of({}, HOME, _terrain(500.0, 500.0, 500.0)) == GroundCheck()


def test_a_terrain_of_another_place_or_datum_is_refused() -> None:
    terrain = _terrain(500.0, 500.0, 500.0)
    elsewhere = enu_from_geodetic(GeodeticPosition(46.1, 7.75, 500.0), HOME)
    with pytest.raises(InvalidInputError, match=r"at any of the 1 candidates, around 46\.1"):
        GroundCheck.of({"one": elsewhere}, HOME, terrain)
    require_datum(terrain, AltitudeDatum.SEA_LEVEL)
    with pytest.raises(InvalidInputError, match="above sea level, the scene's altitudes above the place"):
        require_datum(terrain, AltitudeDatum.TAKEOFF)


@pytest.mark.parametrize("extent_m", [(300.0, 300.0), (30_000.0, 10.0)])
def test_many_points_make_no_more_heights_than_a_terrain_has(extent_m: tuple[float, float]) -> None:
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (100_000, 3)) * (*extent_m, 1.0)
    terrain = ground_of_points(geodetic_coordinates(points, HOME), AltitudeDatum.SEA_LEVEL)
    assert len(terrain.heights_m) > 500
