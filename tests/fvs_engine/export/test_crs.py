import struct
from pathlib import Path

import numpy as np
import pyproj
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.export.crs import ProjectedCrs, geoid_height_m
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_schema.scenes import AltitudeDatum

BRIGHTON = GeodeticPosition(50.82, -0.14, 80.0)


@pytest.mark.parametrize(
    ("latitude", "longitude", "epsg"),
    [
        (50.82, -0.14, 32630),
        (-33.9, 18.4, 32734),
        (0.0, 180.0, 32601),
        (10.0, -180.0, 32601),
        (84.1, 0.0, 5041),
        (-80.1, 0.0, 5042),
    ],
)
def test_the_zone_of_a_place(latitude: float, longitude: float, epsg: int) -> None:
    position = GeodeticPosition(latitude, longitude, 0.0)
    crs = ProjectedCrs.at(position)
    crs.require_covers(position)
    assert crs.epsg == epsg


@pytest.mark.parametrize(
    ("epsg", "message"),
    [
        (99_999, "no CRS with the code EPSG:99999"),
        (4326, "not a projected CRS in metres"),
        (2263, "not a projected CRS in metres"),  # feet
        (7405, "has heights of its own"),
    ],
)
def test_codes_that_cannot_be_used(epsg: int, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message) as refused:
        ProjectedCrs(epsg)
    assert refused.value.hint


def test_a_crs_is_for_its_area_and_a_little_more() -> None:
    ProjectedCrs(32631).require_covers(BRIGHTON)  # the next zone: Greenwich lies between them
    with pytest.raises(InvalidInputError, match="is not for") as refused:
        ProjectedCrs(32633).require_covers(BRIGHTON)
    assert "EPSG:32630" in refused.value.hint
    ProjectedCrs(3832).require_covers(GeodeticPosition(-17.0, -179.9, 0.0))  # Pacific, across 180°


@pytest.mark.parametrize("datum", list(AltitudeDatum))
def test_wkt_is_understood(datum: AltitudeDatum) -> None:
    crs = pyproj.CRS.from_wkt(ProjectedCrs(27_700).wkt(datum))
    assert "British National Grid" in crs.name
    assert len(crs.axis_info) == (2 if datum is AltitudeDatum.TAKEOFF else 3)
    assert crs.is_compound is (datum is AltitudeDatum.SEA_LEVEL)


def test_the_geoid_is_interpolated_in_a_grid(tmp_path: Path) -> None:
    """GTX: the southwest corner, the steps and the size, then rows from south to north, big-endian."""
    grid = tmp_path / 'a geoid, "EGM96".gtx'
    rows = np.array([[40.0, 44.0], [50.0, 54.0]], ">f4")
    grid.write_bytes(struct.pack(">4d2i", 50.0, -1.0, 1.0, 1.0, 2, 2) + rows.tobytes())
    assert geoid_height_m(grid, GeodeticPosition(50.5, -0.5, 0.0)) == pytest.approx(47.0)
    assert geoid_height_m(46.25, BRIGHTON) == 46.25
    with pytest.raises(InvalidInputError, match="does not cover"):
        geoid_height_m(grid, GeodeticPosition(10.0, 10.0, 0.0))


@pytest.mark.parametrize(("content", "message"), [(None, "no such file"), (b"not a grid", "is not a grid")])
def test_files_that_are_no_geoid(tmp_path: Path, content: bytes | None, message: str) -> None:
    file = tmp_path / "geoid.gtx"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InvalidInputError, match=message) as refused:
        geoid_height_m(file, BRIGHTON)
    assert refused.value.path == file
