"""Height models in files: in other CRSs, with holes, in feet, and files that are none."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from fvs_client import AltitudeDatum, FramePose, HeightModel, HeightModelError, Origin, VehiclePose
from fvs_client.height_model import places_of
from rasterio.transform import Affine
from rasterio.warp import transform

from fvs_schema.terrain import MOST_HEIGHTS

MIDDLE = (46.02, 7.75)
_SIDE = 120
Make = Callable[..., Path]


def _in(crs: str, place: tuple[float, float]) -> tuple[float, float]:
    (x,), (y,) = transform("EPSG:4326", crs, [place[1]], [place[0]])
    return x, y


def _slope(crs: str, place: tuple[float, float]) -> float:
    """The height of the ground in the made files: 0.1 up a unit to the east, 0.05 to the north."""
    x, y = _in(crs, place)
    middle = _in(crs, MIDDLE)
    return 500.0 + 0.1 * (x - middle[0]) + 0.05 * (y - middle[1])


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def make(
        crs: str | None = "EPSG:32632",
        pixel: float = 1.0,
        hole: Any = None,
        hole_m: float = -9999.0,
        ridge_m: float = 0.0,
        **profile: Any,
    ) -> Path:
        x, y = _in(crs or "EPSG:32632", MIDDLE)
        offsets = (np.arange(_SIDE) + 0.5 - _SIDE / 2) * pixel
        heights = (500.0 + 0.1 * offsets[None, :] - 0.05 * offsets[:, None]).astype(np.float32)
        if ridge_m:
            heights[:, _SIDE // 2] += ridge_m
        if hole is not None:
            heights[hole] = hole_m
        path = tmp_path / f"{crs}-{profile}.tif".replace(":", "-")
        half = _SIDE / 2 * pixel
        given = {"count": 1, "nodata": -9999.0, "compress": "deflate", "predictor": 3} | profile
        with rasterio.open(
            *(path, "w"),
            driver="GTiff",
            width=_SIDE,
            height=_SIDE,
            dtype="float32",
            crs=crs,
            transform=Affine(pixel, 0.0, x - half, 0.0, -pixel, y + half),
            **given,
        ) as file:
            for band in range(1, given["count"] + 1):
                file.write(heights, band)
        return path

    return make


@pytest.mark.parametrize(
    ("crs", "pixel"),
    [("EPSG:32632", 1.0), ("EPSG:2056", 1.0), ("EPSG:3857", 1.0), ("EPSG:4326", 1e-5), ("EPSG:32633", 1.0)],
)
def test_heights_are_those_of_the_file_whatever_its_crs(make: Make, crs: str, pixel: float) -> None:
    places = [MIDDLE, (46.0202, 7.7502), (46.0198, 7.7497)]
    with HeightModel(make(crs, pixel)) as model:
        terrain = model.around(places)
    assert terrain.altitude_datum is AltitudeDatum.SEA_LEVEL
    for place in places:
        assert terrain.height_m(place) == pytest.approx(_slope(crs, place), abs=0.02)


def test_holes_stay_holes(make: Make) -> None:
    (longitude,), (latitude,) = transform(
        "EPSG:32632", "EPSG:4326", *([value] for value in np.add(_in("EPSG:32632", MIDDLE), (25.0, 15.0)))
    )
    hole = (latitude, longitude)
    with HeightModel(make(hole=np.s_[40:50, 80:90])) as model:
        terrain = model.around([MIDDLE, hole])
    assert terrain.height_m(hole) is None
    assert terrain.height_m(MIDDLE) == pytest.approx(500.0, abs=0.02)


@pytest.mark.parametrize("hole_m", [-9999.0, -3.4e38, 1e30])
def test_holes_that_are_not_declared_are_no_ground(make: Make, hole_m: float) -> None:
    """Else everything would be high above it."""
    with (
        HeightModel(make(hole=np.s_[55:58, 61:64], hole_m=hole_m, nodata=None)) as model,
        pytest.raises(HeightModelError, match="does not declare"),
    ):
        model.around([MIDDLE])


def test_a_wide_flight_gets_a_coarser_grid(make: Make) -> None:
    with HeightModel(make("EPSG:4326", 1e-5)) as model:
        terrain = model.around([(46.0195, 7.7495), (46.0205, 7.7505), (46.0206, 7.77)])
    assert len(terrain.heights_m) <= MOST_HEIGHTS
    assert terrain.longitude_step_deg > 1e-5
    cell = terrain.longitude_step_deg / 1e-5
    assert 500.0 <= terrain.height_m(MIDDLE) <= 500.0 + 0.15 * cell
    assert terrain.height_m((46.0206, 7.77)) is None


def test_a_coarser_grid_keeps_a_narrow_ridge(make: Make) -> None:
    with HeightModel(make("EPSG:4326", 1e-5, ridge_m=80.0)) as model:
        terrain = model.around([(46.0195, 7.7495), (46.0205, 7.7505), (46.0206, 7.77)])
    assert max(filter(None, terrain.heights_m)) >= 580.0


@pytest.mark.parametrize(("crs", "metres"), [("EPSG:32632+8228", 0.3048), ("EPSG:32632+5773", 1.0)])
def test_heights_in_feet_become_metres(make: Make, crs: str, metres: float) -> None:
    with HeightModel(make(crs)) as model:
        assert model.around([MIDDLE]).height_m(MIDDLE) == pytest.approx(500.0 * metres, abs=0.02)


def test_heights_of_a_geographic_crs_in_three_dimensions_are_above_the_ellipsoid(make: Make) -> None:
    with HeightModel(make("EPSG:4979", 1e-5)) as model:
        assert model.around([MIDDLE]).altitude_datum is AltitudeDatum.ELLIPSOID


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_files_that_are_no_height_model_say_why(make: Make, tmp_path: Path) -> None:
    text = tmp_path / "notes.tif"
    text.write_text("no raster")
    for path, said in (
        (text, "notes.tif is no height model"),
        (make(None), "says no CRS"),
        (make(count=3), "it has 3 bands"),
    ):
        with pytest.raises(HeightModelError, match=said):
            HeightModel(path)
    with HeightModel(make()) as model, pytest.raises(HeightModelError, match=r"no height around 47\.0"):
        model.around([(47.0, 8.0)])


def test_poses_of_the_world_frame_have_a_place() -> None:
    origin = Origin(latitude_deg=46.02, longitude_deg=7.75, altitude_m=500.0)
    pose = VehiclePose(latitude_deg=1.0, longitude_deg=2.0, altitude_m=3.0, yaw_deg=0.0, pitch_deg=0.0)
    world = FramePose(position=(100.0, 200.0, 3.0), orientation_wxyz=(1.0, 0.0, 0.0, 0.0))
    (first, second) = places_of([pose, world], origin)
    assert first == (1.0, 2.0)
    assert second == pytest.approx((46.021799, 7.751294), abs=1e-5)
    for lost, of in ((world, None), (world.model_copy(update={"frame": "model"}), origin)):
        with pytest.raises(HeightModelError, match="latitude and longitude"):
            places_of([lost], of)


@pytest.mark.process
def test_without_rasterio_the_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['rasterio'] = None\n"
        "from fvs_client import HeightModel, HeightModelError\n"
        "try: HeightModel('ground.tif')\n"
        "except HeightModelError as error: print(error.hint)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "fvs-client[terrain]" in ran.stdout
