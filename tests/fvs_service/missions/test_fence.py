"""Geofences, also across the antimeridian."""

import json
from itertools import pairwise
from typing import Any

import pytest
from fvs_service.missions.fence import Fence
from fvs_service.missions.model import MissionOptions
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

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
    one, other = (
        MissionOptions.model_validate({"format": "csv", "geofence": text}).fence
        for text in ("1,2;3,4;5,6", "1,2;3,4;5,6;1,2")
    )
    assert one == other == ((1, 2), (3, 4), (5, 6))


def test_routes_and_fences_across_the_antimeridian_are_cut_there(flights: Any) -> None:
    flight = next(one for one in flights if one.origin.longitude_deg == 179.9999 and len(one.views) == 5)
    fence = "-17,179;-17,-179;-16,-179;-16,179"
    document = json.loads(flight.write(format="geojson", geofence=fence))
    route = next(one for one in document["features"] if one["properties"]["kind"] == "route")["geometry"]
    assert route["type"] == "MultiLineString"
    for before, after in zip(route["coordinates"][:-1], route["coordinates"][1:], strict=True):
        assert abs(before[-1][0]) == 180.0
        assert (after[0][0], after[0][1]) == (-before[-1][0], before[-1][1])
    for line in route["coordinates"]:
        assert all(abs(a[0] - b[0]) < 1 for a, b in pairwise(line))
    (ring,) = document["features"][-1]["geometry"]["coordinates"]
    assert [corner[0] for corner in ring] in ([179.0, 181.0, 181.0, 179.0, 179.0], [179, 179, 181, 181, 179])
