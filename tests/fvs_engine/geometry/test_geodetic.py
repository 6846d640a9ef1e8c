import math

import numpy as np
import pytest
from hypothesis import given
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
angles = st.floats(-179.0, 179.0)


def test_a_second_of_latitude_is_north_by_its_arc() -> None:
    """WGS 84: the meridian's radius of curvature at 48° is a(1 − e²)/(1 − e² sin²φ)^1.5."""
    e2 = 6.69437999014e-3
    radius = 6_378_137.0 * (1 - e2) / (1 - e2 * math.sin(math.radians(48.0)) ** 2) ** 1.5
    east, north, up = enu_from_geodetic(GeodeticPosition(48.0 + 1 / 3600, 7.0, 400.0), ORIGIN)
    assert north == pytest.approx((radius + 400.0) * math.radians(1 / 3600), abs=1e-3)
    assert (east, up) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-3))


@given(st.tuples(*[st.floats(-2_000.0, 2_000.0)] * 3))
def test_places_come_back(position: tuple[float, float, float]) -> None:
    place = geodetic_from_enu(np.array(position), ORIGIN)
    np.testing.assert_allclose(enu_from_geodetic(place, ORIGIN), position, atol=1e-6)


@pytest.mark.parametrize("values", [(91, 0, 0), (0, 181, 0), (0, 0, math.nan), (math.nan, 0, 0)])
def test_places_that_are_not_on_earth_are_refused(values: tuple[float, float, float]) -> None:
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


@given(angles, st.floats(-89.0, 89.0), angles)
def test_attitudes_come_back(yaw: float, pitch: float, roll: float) -> None:
    found = attitude_of(camera_at(np.zeros(3), yaw, pitch, roll))
    assert math.isclose((found[0] - yaw + 180.0) % 360.0, 180.0, abs_tol=1e-6)
    assert found[1:] == (pytest.approx(pitch, abs=1e-6), pytest.approx(roll, abs=1e-6))


@given(angles, st.sampled_from([-90.0, 90.0]))
def test_straight_up_and_down_yaw_is_the_whole_turn(yaw: float, pitch: float) -> None:
    camera = camera_at(np.zeros(3), yaw, pitch)
    again = camera_at(np.zeros(3), *attitude_of(camera))
    np.testing.assert_allclose(again.rotation, camera.rotation, atol=1e-9)
