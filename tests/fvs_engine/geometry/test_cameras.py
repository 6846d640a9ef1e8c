import numpy as np
import pycolmap
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import CAMERA_MODELS, DistortedCamera, PinholeCamera

LENSES = {
    "SIMPLE_PINHOLE": (900.0, 640.0, 360.0),
    "PINHOLE": (900.0, 880.0, 630.0, 370.0),
    "SIMPLE_RADIAL": (900.0, 640.0, 360.0, -0.12),
    "RADIAL": (900.0, 640.0, 360.0, -0.2, 0.05),
    "OPENCV": (900.0, 880.0, 630.0, 370.0, -0.25, 0.09, 0.002, -0.001),
    "SIMPLE_FISHEYE": (500.0, 630.0, 370.0),
    "FISHEYE": (500.0, 490.0, 630.0, 370.0),
    "SIMPLE_RADIAL_FISHEYE": (500.0, 630.0, 370.0, 0.02),
    "RADIAL_FISHEYE": (500.0, 630.0, 370.0, 0.02, -0.01),
    "OPENCV_FISHEYE": (500.0, 490.0, 630.0, 370.0, 0.02, -0.01, 0.003, -0.0004),
    "FULL_OPENCV": (900.0, 880.0, 630.0, 370.0, 0.3, -0.1, 0.001, 0.002, 0.02, 0.5, -0.05, 0.01),
}
MODELS = sorted(CAMERA_MODELS)


def lens(model: str) -> DistortedCamera:
    return DistortedCamera(model, 1280, 720, LENSES[model])


def colmap(camera: DistortedCamera) -> pycolmap.Camera:
    return pycolmap.Camera(
        model=camera.model, width=camera.width, height=camera.height, params=list(camera.params)
    )


pixels_in_view = st.tuples(st.floats(0, 1280), st.floats(0, 720))
depths = st.floats(0.05, 500)


@pytest.mark.parametrize("model", MODELS)
@given(pixel=pixels_in_view, depth=depths)
def test_project_undoes_unproject(model, pixel, depth):
    camera = lens(model)
    point = camera.unproject(pixel, depth)
    assert point[2] == depth
    np.testing.assert_allclose(camera.project(point), pixel, atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
@given(pixel=pixels_in_view, depth=depths)
def test_distorted_cameras_agree_with_colmap(model, pixel, depth):
    camera = lens(model)
    point = camera.unproject(pixel, depth)
    np.testing.assert_allclose(colmap(camera).img_from_cam(point), camera.project(point), atol=1e-8)
    np.testing.assert_allclose(point[:2] / depth, colmap(camera).cam_from_img(np.array(pixel)), atol=1e-8)


@given(pixel=pixels_in_view, depth=depths)
def test_pinhole_agrees_with_its_matrix(pixel, depth):
    camera = PinholeCamera(1280, 720, 900.0, 880.0, 630.0, 370.0)
    point = camera.unproject(pixel, depth)
    homogeneous = camera.matrix @ point
    np.testing.assert_allclose(homogeneous[:2] / homogeneous[2], pixel, atol=1e-9)
    np.testing.assert_allclose(camera.project(point), pixel, atol=1e-9)


@pytest.mark.parametrize("camera", [lens(model) for model in MODELS] + [PinholeCamera(8, 6, 5, 5, 4, 3)])
def test_nothing_behind_the_camera_has_a_pixel(camera):
    points = np.array([[0.0, 0.0, -1.0], [0.1, 0.2, 0.0], [0.0, 0.0, 1.0]])
    pixels = camera.project(points)
    assert np.isnan(pixels[:2]).all()
    np.testing.assert_allclose(pixels[2], [camera.cx, camera.cy])


def test_points_beyond_the_fold_stay_out_of_the_image():
    camera = lens("SIMPLE_RADIAL")  # r (1 − 0.12 r²) turns back at r = √(1 / 0.36) = 1.67
    fold = np.sqrt(1 / 0.36)
    assert np.isfinite(camera.project([0.999 * fold, 0.0, 1.0])).all()
    assert np.isnan(camera.project([1.001 * fold, 0.0, 1.0])).all()
    assert np.isnan(camera.project([2.8, 0.0, 1.0])).all()  # the bare polynomial puts this inside the image


def test_pixels_that_no_ray_reaches_have_no_point():
    camera = lens("SIMPLE_RADIAL")
    largest = np.sqrt(1 / 0.36) * (1 - 0.12 / 0.36)
    assert np.isfinite(camera.unproject([640 + 900 * 0.999 * largest, 360])).all()
    assert np.isnan(camera.unproject([640 + 900 * 1.001 * largest, 360])[:2]).all()


@pytest.mark.parametrize("model", MODELS)
@given(pixel=pixels_in_view)
def test_resizing_scales_pixels(model, pixel):
    camera = lens(model)
    half = camera.resized(640, 360)
    np.testing.assert_allclose(half.project(camera.unproject(pixel)), np.array(pixel) / 2, atol=1e-6)


def test_many_points_at_once_are_like_one_at_a_time():
    camera = lens("OPENCV")
    pixels = np.random.default_rng(1).uniform([0, 0], [1280, 720], size=(4, 5, 2))
    together = camera.unproject(pixels, depth=np.full((4, 5), 2.0))
    assert together.shape == (4, 5, 3)
    np.testing.assert_allclose(together[2, 3], camera.unproject(pixels[2, 3], 2.0), atol=1e-12)


@pytest.mark.parametrize(
    ("model", "width", "params"),
    [
        ("THIN_PRISM", 100, (1.0, 2.0, 3.0)),
        ("PINHOLE", 100, (90.0, 50.0, 50.0)),
        ("PINHOLE", 0, (90.0, 90.0, 50.0, 50.0)),
        ("PINHOLE", 100, (-90.0, 90.0, 50.0, 50.0)),
        ("PINHOLE", 100, (90.0, 90.0, float("nan"), 50.0)),
        ("SIMPLE_RADIAL", 100, (90.0, 50.0, 50.0, float("inf"))),
    ],
)
def test_impossible_cameras_are_refused(model, width, params):
    with pytest.raises(InvalidInputError):
        DistortedCamera(model, width, 100, params)


def test_impossible_pinholes_are_refused():
    with pytest.raises(InvalidInputError):
        PinholeCamera(100, 100, 0.0, 90.0, 50.0, 50.0)
    with pytest.raises(InvalidInputError):
        PinholeCamera(100, -1, 90.0, 90.0, 50.0, 50.0)
    with pytest.raises(InvalidInputError):
        PinholeCamera(100, 100, 90.0, float("inf"), 50.0, 50.0)
