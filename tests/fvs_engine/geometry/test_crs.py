import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.crs import NamedCrs
from fvs_schema.scenes import AltitudeDatum


@pytest.mark.parametrize(
    ("name", "coordinates", "expected"),
    [
        ("EPSG:4326", (-91.99, 46.84, 198.6), (46.84, -91.99, 198.6)),
        ("WGS84 UTM 33N", (500_000, 0, 5), (0.0, 15.0, 5.0)),
        ("wgs84 utm zone 33 S", (500_000, 10_000_000, 5), (0.0, 15.0, 5.0)),
        ("+proj=utm +zone=33 +datum=WGS84 +units=m", (500_000, 0, 5), (0.0, 15.0, 5.0)),
        ("EPSG:25832+5783", (500_000, 0, 5), None),  # Africa is not in Europe
        ("EPSG:5041", (2_000_000, 2_000_000, 9), (90.0, 0.0, 9.0)),
        ("EPSG:4326", (180.25, -17, 0), (-17.0, -179.75, 0.0)),
        ("EPSG:4978", (6_378_137 + 50, 0, 0), (0.0, 0.0, 50.0)),
        ("EPSG:2263+6360", (984_250, 0, 100), (40.1666667, -74.0, 30.4800610)),  # feet and feet
    ],
)
def test_positions(
    name: str, coordinates: tuple[float, ...], expected: tuple[float, float, float] | None
) -> None:
    crs = NamedCrs(name)
    if expected is None:
        with pytest.raises(InvalidInputError, match="not in the area"):
            crs.geodetic(np.array([coordinates]))
        return
    (found,) = crs.geodetic(np.array([coordinates], dtype=float))
    given = (found.latitude_deg, found.longitude_deg, found.altitude_m)
    np.testing.assert_allclose(given, expected, atol=2e-4)


@pytest.mark.parametrize(
    ("name", "datum"),
    [
        ("EPSG:25832", None),
        ("EPSG:25832+5783", AltitudeDatum.SEA_LEVEL),
        ("EPSG:4979", AltitudeDatum.ELLIPSOID),
    ],
)
def test_the_datum_of_heights(name: str, datum: AltitudeDatum | None) -> None:
    assert NamedCrs(name).altitude_datum is datum


@pytest.mark.parametrize("name", ["EPSG:99999", "WGS84 UTM 61N", "north of the church", "EPSG:5783"])
def test_what_is_no_crs(name: str) -> None:
    with pytest.raises(InvalidInputError) as raised:
        NamedCrs(name)
    assert name in raised.value.message
    assert "EPSG:25832" in raised.value.hint


@pytest.mark.parametrize(
    ("name", "coordinates"),
    [
        ("EPSG:4326", (46.84, -91.99, 198.6)),
        ("EPSG:25832", (5_300_000, 500_000, 1)),
        ("+proj=utm +zone=10 +datum=WGS84 +units=m", (5_300_000, 500_000, 1)),
        ("EPSG:4978", (4e6, 7e5, 4e6)),
    ],
)
def test_coordinates_in_another_order_are_refused(name: str, coordinates: tuple[float, ...]) -> None:
    with pytest.raises(InvalidInputError) as raised:
        NamedCrs(name).geodetic(np.array([coordinates], dtype=float))
    assert "x is east" in raised.value.hint


def test_a_crs_whose_file_of_shifts_is_missing_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="cannot be converted") as raised:
        NamedCrs("+proj=tmerc +lon_0=9 +x_0=3500000 +ellps=bessel +nadgrids=not_here.gsb")
    assert "file" in raised.value.hint
