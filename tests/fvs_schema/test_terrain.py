"""Heights of the ground on a grid."""

from typing import Any

import pytest

from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import NO_HEIGHT_M, Terrain


def terrain(**given: Any) -> Terrain:
    """Three rows of four: 1 m up a step to the east, 10 m up a step to the north."""
    fields: dict[str, Any] = {
        "south_deg": 46.0,
        "west_deg": 7.0,
        "latitude_step_deg": 0.1,
        "longitude_step_deg": 0.2,
        "columns": 4,
        "heights_m": tuple(10.0 * row + column for row in range(3) for column in range(4)),
    }
    return Terrain(**fields | given)


def test_the_ground_is_bilinear_up_to_its_edges() -> None:
    found = terrain()
    places = [(46.0, 7.0), (46.2, 7.6), (46.15, 7.3), (46.0, 7.05)]
    heights = [found.height_m(place) for place in places]
    assert heights == pytest.approx([0.0, 23.0, 16.5, 0.25])
    outside = [(45.999, 7.1), (46.201, 7.1), (46.1, 6.999), (46.1, 7.601), (-46.1, 7.1), (46.1, -172.9)]
    assert [found.height_m(place) for place in outside] == [None] * len(outside)


@pytest.mark.parametrize("hole_m", [NO_HEIGHT_M, -12_001.0])
def test_a_hole_has_no_height_nor_has_the_ground_beside_it(hole_m: float) -> None:
    heights = [10.0 * row + column for row in range(3) for column in range(4)]
    heights[1 * 4 + 1] = hole_m
    found = terrain(heights_m=tuple(heights))
    assert found.height_m((46.1, 7.2)) is None
    assert found.height_m((46.05, 7.3)) is None
    assert found.height_m((46.1, 7.4)) == pytest.approx(12.0)  # a height of its own
    assert found.height_m((46.15, 7.5)) == pytest.approx(17.5)


def test_the_grid_may_cross_the_antimeridian() -> None:
    found = terrain(west_deg=179.9)
    assert found.height_m((46.0, 179.9)) == pytest.approx(0.0)
    assert found.height_m((46.0, -179.9)) == pytest.approx(1.0)
    assert found.height_m((46.0, -179.5)) == pytest.approx(3.0)
    assert found.height_m((46.0, 179.8)) is None
    way = list(found.along((46.0, 179.9), (46.0, -179.9)))
    assert [place[1] for _, place in way] == pytest.approx([179.9, -180.0, -179.9])


def test_a_raised_ground_keeps_its_holes() -> None:
    heights = [10.0 * row + column for row in range(3) for column in range(4)]
    heights[5] = NO_HEIGHT_M
    raised = terrain(heights_m=tuple(heights)).raised(30_000.0, AltitudeDatum.TAKEOFF)
    assert raised.altitude_datum is AltitudeDatum.TAKEOFF
    assert raised.height_m((46.0, 7.0)) == pytest.approx(30_000.0)
    assert raised.height_m((46.1, 7.2)) is None


def test_a_way_is_sampled_every_half_step() -> None:
    way = list(terrain().along((46.0, 7.0), (46.2, 7.0)))
    assert [share for share, _ in way] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert way[1][1] == pytest.approx((46.05, 7.0))
    assert [share for share, _ in terrain().along((46.0, 7.0), (46.0, 7.0))] == [0.0, 1.0]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"columns": 5}, "12 heights are not two or more rows of 5"),
        ({"columns": 12}, "12 heights are not two or more rows of 12"),
        ({"columns": 2, "heights_m": (0.0,) * 502}, "more than 250 rows"),
        ({"heights_m": (float("nan"),) * 12}, "finite"),
        ({"latitude_step_deg": 0.0}, "must be at least"),
    ],
)
def test_what_is_no_grid_of_heights_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        terrain(**given)
