"""Geofences, also across the antimeridian."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from fvs_schema.fence import Fence
from fvs_schema.missions import MissionOptions

TRIANGLE = ((0.0, 0.0), (2.0, 0.0), (0.0, 2.0))


@given(
    st.floats(-1, 3).filter(lambda x: abs(x) > 1e-6),
    st.floats(-1, 3).filter(lambda x: abs(x) > 1e-6),
    st.sampled_from([0.0, 8.5, 179.0, -180.0, 178.5]),
)
def test_a_triangle_has_what_is_inside_it(latitude: float, longitude: float, east: float) -> None:
    if abs(latitude + longitude - 2.0) < 1e-6:
        return
    fence = Fence([(corner[0], _turned(corner[1] + east)) for corner in TRIANGLE])
    inside = latitude > 0 and longitude > 0 and latitude + longitude < 2.0
    assert fence.has((latitude, _turned(longitude + east))) == inside


def _turned(longitude: float) -> float:
    return (longitude + 180.0) % 360.0 - 180.0


def test_ways_cross_edges_also_between_two_outside_and_two_inside() -> None:
    notch = Fence([(0, 179), (0, -179), (2, -179), (1, 180), (2, 179)])
    assert notch.has((1.5, 179.1))
    assert notch.has((1.5, -179.1))
    assert notch.crosses((1.5, 179.1), (1.5, -179.1))
    assert not notch.crosses((0.5, 179.1), (0.5, -179.1))
    assert notch.crosses((-1.0, 180.0), (0.5, 180.0))


def test_a_way_through_two_corners_is_outside_between_them() -> None:
    corners = [(0, 0), (0, 6), (4, 6), (4, 3.01), (2, 4), (1, 3), (2, 2), (4, 2.99), (4, 0)]
    bay = Fence(corners)
    assert bay.has((2, 1))
    assert bay.has((2, 5))
    assert not bay.has((2, 3))
    assert bay.crosses((2, 1), (2, 5))
    assert bay.crosses((2, 5), (2, 1))
    assert bay.crosses((2, 1), (2, 3))
    assert not bay.crosses((1, 1), (1, 5))  # it only touches the corner (1, 3)
    assert not bay.crosses((0.5, 1), (2, 2))  # and this one ends at one
    assert bay.crosses((3, 4), (3, 2))
    reversed_bay = Fence(corners[::-1])
    assert reversed_bay.crosses((2, 1), (2, 5))
    assert not reversed_bay.crosses((1, 1), (1, 5))


def test_a_way_may_run_along_an_edge() -> None:
    step = Fence([(0, 0), (0, 6), (2, 6), (2, 4), (1, 4), (1, 2), (2, 2), (2, 0)])
    assert not step.crosses((1, 1), (1, 5))
    assert step.crosses((2, 1), (2, 5))
    assert not step.crosses((1, 1), (1, 1))


@given(
    *[st.tuples(st.integers(0, 8), st.integers(0, 8)) for _ in range(2)],
    st.sampled_from([0.0, 178.5, -180.0]),
)
def test_ways_on_a_grid_cross_where_they_are_outside(
    start: tuple[int, int], end: tuple[int, int], east: float
) -> None:
    """Corners, edges and ends on whole numbers: the way is sampled beside them."""
    assume(_in_bay(*start) and _in_bay(*end))
    corners = [(0, 0), (0, 8), (8, 8), (8, 6), (4, 6), (6, 4), (4, 2), (8, 2), (8, 0)]
    fence = Fence([(latitude, _turned(longitude + east)) for latitude, longitude in corners])
    shares = [(number + 0.5) / 420 for number in range(420)]
    places = [(start[0] + (end[0] - start[0]) * t, start[1] + (end[1] - start[1]) * t) for t in shares]
    outside = [not _in_bay(*place) for place in places]
    turned = [(latitude, _turned(longitude + east)) for latitude, longitude in (start, end)]
    assert fence.crosses(*turned) == any(outside)


def _in_bay(latitude: float, longitude: float) -> bool:
    """Inside, or on the fence."""
    low, high = 1e-9, 2.0 - 1e-9
    east = abs(longitude - 4.0)  # symmetric about 4
    return latitude <= 4.0 + low or east >= high or latitude <= 6.0 - east + low


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a latitude"),
        ("1,2;3,4", "3 to 200 corners"),
        ("1,2;3,4;1,2", "3 to 200 corners"),
        ("1,2;3,4;5", "is not a latitude"),
        ("1,2;3,4;5,north", "is not a latitude"),
        ("1,2;3,4;91,0", "is not on Earth"),
        ("1,2;3,4;nan,0", "is not on Earth"),
        ("1,2;3,4;0,inf", "is not on Earth"),
        (";".join(["1,2", "3,4", "5,6"] * 67), "3 to 200 corners"),
    ],
)
def test_what_is_no_polygon_is_refused(text: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        MissionOptions.model_validate({"format": "csv", "geofence": text})


def test_a_closed_polygon_is_the_same_as_an_open_one() -> None:
    one, other = (Fence.parse(text).corners for text in ("1,2;3,4;5,6", "1,2;3,4;5,6;1,2"))
    assert one == other == ((1, 2), (3, 4), (5, 6))
