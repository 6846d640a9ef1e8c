import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import (
    GeodeticPosition,
    attitude_of,
    camera_at,
    enu_from_geodetic,
    geodetic_from_enu,
)

ORIGIN = GeodeticPosition(48.0, 7.0, 400.0)


def test_a_second_of_latitude_is_north_by_its_arc() -> None:
    """WGS 84: the meridian's radius of curvature at 48° is a(1 − e²)/(1 − e² sin²φ)^1.5."""
    e2 = 6.69437999014e-3
    radius = 6_378_137.0 * (1 - e2) / (1 - e2 * math.sin(math.radians(48.0)) ** 2) ** 1.5
    east, north, up = enu_from_geodetic(GeodeticPosition(48.0 + 1 / 3600, 7.0, 400.0), ORIGIN)
    assert north == pytest.approx((radius + 400.0) * math.radians(1 / 3600), abs=1e-3)
    assert (east, up) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-3))


@pytest.mark.parametrize("values", [(91, 0, 0), (0, 181, 0), (0, 0, math.nan), (math.nan, 0, 0)])
def test_positions_that_are_not_on_earth_are_refused(values: tuple[float, float, float]) -> None:
    with pytest.raises(InvalidInputError):
        GeodeticPosition(*values)


@pytest.mark.parametrize(
    ("attitude", "forward", "right"),
    [
        ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
        ((90, 0, 0), (1, 0, 0), (0, -1, 0)),
        ((0, -90, 0), (0, 0, -1), (1, 0, 0)),
        ((0, 30, 0), (0, math.cos(math.pi / 6), 0.5), (1, 0, 0)),
        ((0, 0, 90), (0, 1, 0), (0, 0, -1)),
    ],
)
def test_attitudes_are_those_of_vehicles(
    attitude: tuple[float, float, float], forward: tuple[float, ...], right: tuple[float, ...]
) -> None:
    camera = camera_at(np.zeros(3), *attitude)
    np.testing.assert_allclose(camera.rotation[:, 2], forward, atol=1e-12)
    np.testing.assert_allclose(camera.rotation[:, 0], right, atol=1e-12)


# Above the ellipsoid pymap3d loses 6 nm at 20 km, and a micrometre at 100 km, where nothing flies.
@given(st.tuples(*[st.floats(-1e5, 1e5)] * 2, st.floats(-2e4, 2e4)))
@example((0.0, 0.0, 2e4))
def test_a_position_comes_back_from_its_coordinates(enu: tuple[float, float, float]) -> None:
    found = enu_from_geodetic(geodetic_from_enu(np.array(enu), ORIGIN), ORIGIN)
    np.testing.assert_allclose(found, enu, atol=1e-6)


@given(st.floats(-360, 360), st.floats(-180, 180), st.floats(-180, 180))
@example(123.0, -90.0, 0.0)
@example(123.0, 90.0, 77.0)
@example(123.0, -90.0 + 1e-5, 0.0)
@example(0.0, 180.0, 0.0)
def test_a_camera_comes_back_from_its_attitude(yaw: float, pitch: float, roll: float) -> None:
    camera = camera_at(np.zeros(3), yaw, pitch, roll)
    found = attitude_of(camera)
    assert 0 <= found[0] <= 360
    assert abs(found[1]) <= 90
    np.testing.assert_allclose(camera_at(np.zeros(3), *found).rotation, camera.rotation, atol=1e-6)


def test_a_camera_that_looks_straight_down_has_a_yaw_and_no_roll() -> None:
    assert attitude_of(camera_at(np.zeros(3), 37.0, -90.0)) == pytest.approx((37.0, -90.0, 0.0))
