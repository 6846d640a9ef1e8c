import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import Camera, DistortedCamera, PinholeCamera, RigidTransform
from fvs_engine.scene.photographs import Photographs

WIDTH, HEIGHT = 120, 90
BARREL = DistortedCamera("SIMPLE_RADIAL", WIDTH, HEIGHT, (100.0, 62.0, 44.0, -0.12))
PINCUSHION = DistortedCamera("OPENCV", WIDTH, HEIGHT, (100.0, 98.0, 60.0, 45.0, 0.1, 0.02, 0.001, -0.002))
FISHEYE = DistortedCamera("OPENCV_FISHEYE", WIDTH, HEIGHT, (60.0, 60.0, 60.0, 45.0, 0.05, 0.0, 0.0, 0.0))
IDENTITY = RigidTransform.identity()


@pytest.fixture
def ramp(tmp_path: Path) -> Path:
    """A photograph whose red is twice the column and whose green is twice the row."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([2 * x, 2 * y, 0 * x], axis=-1).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "ramp.png")
    return tmp_path


@pytest.mark.parametrize("camera", [BARREL, PINCUSHION, FISHEYE])
def test_every_pixel_shows_what_its_ray_meets(ramp: Path, camera: Camera) -> None:
    view = Photographs(ramp, WIDTH).load("ramp.png", camera, IDENTITY)
    pixels = np.array([[10.5, 10.5], [60.5, 45.5], [110.5, 80.5], [20.5, 70.5]])
    source = camera.project(view.camera.unproject(pixels))
    shown = view.image[pixels[:, 1].astype(int), pixels[:, 0].astype(int), :2]
    assert np.abs(shown - 2 * (source - 0.5)).max() <= 1.0


@pytest.mark.parametrize("camera", [BARREL, PINCUSHION, FISHEYE])
def test_the_view_is_the_widest_without_an_empty_pixel(ramp: Path, camera: Camera) -> None:
    pinhole = Photographs(ramp, WIDTH).pinhole(camera)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    source = camera.project(pinhole.unproject(np.stack([x, y], axis=-1)))
    margins = [source[..., 0].min(), WIDTH - source[..., 0].max()]
    margins += [source[..., 1].min(), HEIGHT - source[..., 1].max()]
    assert min(margins) >= 0
    assert min(margins) < 0.5


def test_the_training_size_is_never_larger_than_the_photograph(ramp: Path) -> None:
    half = Photographs(ramp, 60).load("ramp.png", PinholeCamera(WIDTH, HEIGHT, 100, 100, 60, 45), IDENTITY)
    assert half.image.shape == (45, 60, 3)
    assert half.camera == PinholeCamera(60, 45, 50, 50, 30, 22.5)
    assert Photographs(ramp, 500).pinhole(BARREL).width == WIDTH


def test_reduced_and_undistorted_agree_with_undistorted_and_reduced(ramp: Path) -> None:
    view = Photographs(ramp, 60).load("ramp.png", PINCUSHION, IDENTITY)
    pixels = np.array([[5.5, 5.5], [30.5, 22.5], [55.5, 40.5]])
    source = PINCUSHION.project(view.camera.unproject(pixels))
    shown = view.image[pixels[:, 1].astype(int), pixels[:, 0].astype(int), :2]
    assert np.abs(shown - 2 * (source - 0.5)).max() <= 2.0


def test_cameras_that_show_the_same_image(ramp: Path) -> None:
    photographs = Photographs(ramp, WIDTH)

    def radial(focal: float, k1: float) -> Camera:
        return DistortedCamera("SIMPLE_RADIAL", WIDTH, HEIGHT, (focal, 62.0, 44.0, k1))

    assert photographs.same_image(BARREL, radial(100.0, -0.12))
    assert photographs.same_image(BARREL, radial(100.01, -0.1201))
    assert not photographs.same_image(BARREL, radial(101.0, -0.12))
    assert not photographs.same_image(BARREL, radial(100.0, -0.13))
    assert not photographs.same_image(BARREL, PinholeCamera(WIDTH, HEIGHT, 100, 100, 62, 44))
    assert not photographs.same_image(BARREL, BARREL.resized(60, 45))


def test_a_camera_that_is_adjusted_again_and_again_does_not_fill_the_memory(ramp: Path) -> None:
    photographs = Photographs(ramp, WIDTH)
    map_bytes = WIDTH * HEIGHT * 2 * 8
    tracemalloc.start()
    try:
        for step in range(12):  # more maps than may be kept
            camera = DistortedCamera("SIMPLE_RADIAL", WIDTH, HEIGHT, (100.0 + 0.1 * step, 62.0, 44.0, -0.12))
            photographs.load("ramp.png", camera, IDENTITY)
        kept_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept_bytes < 10 * map_bytes


def test_photographs_that_do_not_fit_their_cameras(ramp: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"ramp\.png becomes 60×45"):
        Photographs(ramp, 60).load("ramp.png", PinholeCamera(90, 120, 100, 100, 45, 60), IDENTITY)
    with pytest.raises(InvalidInputError, match=r"absent\.png"):
        Photographs(ramp, 60).load("absent.png", BARREL, IDENTITY)
    folded = DistortedCamera("SIMPLE_RADIAL", WIDTH, HEIGHT, (20.0, 60.0, 45.0, -30.0))
    with pytest.raises(InvalidInputError, match="No pinhole view"):
        Photographs(ramp, 60).pinhole(folded)


@pytest.mark.parametrize("camera", [BARREL, FISHEYE, PinholeCamera(WIDTH, HEIGHT, 100, 100, 60, 45)])
@pytest.mark.parametrize("long_side_px", [WIDTH, 45])
def test_a_mask_is_undistorted_and_reduced_with_its_photograph(
    ramp: Path, camera: Camera, long_side_px: int
) -> None:
    counts = np.ones((HEIGHT, WIDTH), dtype=bool)
    counts[20:60, 30:80] = False
    with Image.open(ramp / "ramp.png") as image:
        shown = np.where(counts[..., None], np.asarray(image) * 0 + 200, np.uint8(0))
    Image.fromarray(shown.astype(np.uint8)).save(ramp / "ramp.png")
    assert Photographs(ramp, long_side_px).load("ramp.png", camera, IDENTITY).mask is None
    (ramp / "masks").mkdir()
    Image.fromarray(counts).save(ramp / "masks" / "ramp.png")
    view = Photographs(ramp, long_side_px).load("ramp.png", camera, IDENTITY)
    assert view.mask is not None
    assert view.mask.shape == view.image.shape[:2]
    bright = view.image[..., 0] > 150
    assert view.image[..., 0][view.mask].min() > 150, "nothing black counts"
    assert (bright & ~view.mask).mean() < 0.08, "but all that is away from it"
