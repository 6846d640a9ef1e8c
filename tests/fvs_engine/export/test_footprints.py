import json
from pathlib import Path

import numpy as np
import pytest

from fvs_engine.export.footprints import split_at_antimeridian, write_footprints
from fvs_engine.export.placement import Placement
from fvs_engine.geometry import PinholeCamera
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, enu_from_geodetic
from fvs_engine.views import PinholeView
from fvs_schema.scenes import Alignment, Origin

CAMERA = PinholeCamera(400, 300, 200.0, 200.0, 200.0, 150.0)
ORIGIN = Origin(latitude_deg=48.0, longitude_deg=7.0, altitude_m=400.0, altitude_datum="ellipsoid")
GROUND = np.random.default_rng(0).uniform([-100.0, -100.0, -0.5], [100.0, 100.0, 0.5], (2000, 3))


def _footprint(folder: Path, yaw_deg: float, pitch_deg: float) -> np.ndarray:
    """The corners on the ground in metres, of a camera 50 m above it."""
    camera = camera_at(np.array([0.0, 0.0, 50.0]), yaw_deg, pitch_deg)
    view = PinholeView("a.jpg", CAMERA, camera.inverse())
    write_footprints(folder / "cameras.geojson", [view], GROUND, Placement(ORIGIN, Alignment()))
    document = json.loads((folder / "cameras.geojson").read_text())
    (ring,) = document["features"][1]["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    origin = GeodeticPosition(48.0, 7.0, 400.0)
    return np.array(
        [
            enu_from_geodetic(GeodeticPosition(latitude, longitude, 400.0), origin)[:2]
            for longitude, latitude in ring[:-1]
        ]
    )


def test_straight_down_it_is_the_image_at_its_scale(tmp_path: Path) -> None:
    corners = _footprint(tmp_path, 0.0, -90.0)
    np.testing.assert_allclose(np.abs(corners), [[50.0, 37.5]] * 4, atol=0.1)


def test_above_the_horizon_it_ends(tmp_path: Path) -> None:
    corners = _footprint(tmp_path, 0.0, -5.0)  # the upper edge is 32° above the horizon
    assert corners[:, 1].min() == pytest.approx(50.0 / np.tan(np.deg2rad(5.0) + np.arctan(0.75)), abs=0.2)
    assert 150.0 < np.linalg.norm(corners, axis=1).max() < 300.0


def test_polygons_are_split_at_the_antimeridian() -> None:
    ring = np.array([[179.9, 1.0], [179.9, 1.1], [-179.8, 1.1], [-179.8, 1.0]])
    west, east = sorted(split_at_antimeridian(ring), key=lambda part: -part[0, 0])
    assert (west[:, 0].min(), west[:, 0].max()) == (pytest.approx(179.9), 180.0)
    assert (east[:, 0].min(), east[:, 0].max()) == (-180.0, pytest.approx(-179.8))
    assert _area(west) == pytest.approx(0.1 * 0.1)
    assert _area(east) == pytest.approx(0.2 * 0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_polygon_around_a_pole_reaches_it(sign: float) -> None:
    ring = np.array([[longitude, sign * 89.99] for longitude in (10.0, 100.0, -170.0, -80.0)])
    parts = split_at_antimeridian(ring)
    assert sum(map(_area, parts)) == pytest.approx(360.0 * 0.01)
    for part in parts:
        assert np.abs(part[:, 0]).max() <= 180.0
        assert np.abs(part[:, 1]).max() == 90.0


def test_another_polygon_stays_as_it_is_but_for_its_direction() -> None:
    clockwise = np.array([[7.0, 48.0], [7.0, 48.1], [7.1, 48.1], [7.1, 48.0]])
    (ring,) = split_at_antimeridian(clockwise)
    np.testing.assert_allclose(ring, clockwise[::-1])


def _area(ring: np.ndarray) -> float:
    """Positive for counterclockwise ones."""
    x, y = ring.T
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
