"""Refined focal lengths against EXIF's, or those of usual lenses."""

import pycolmap
import pytest

from fvs_engine.sfm.verification.evidence import unlikely_focal_lengths


def model(*focal_px: float) -> pycolmap.Reconstruction:
    """One image of 1000 × 750 px by each camera."""
    made = pycolmap.Reconstruction()
    for number, focal in enumerate(focal_px, start=1):
        camera = pycolmap.Camera.create_from_model_name(number, "SIMPLE_RADIAL", focal, 1000, 750)
        made.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(image_id=number, name=f"{number}.jpg", camera_id=number)
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    return made


@pytest.mark.parametrize(
    ("focal_px", "prior", "likely"),
    [
        (650.0, None, True),
        (150.0, None, False),
        (4300.0, None, False),
        (4300.0, 4500.0, True),  # a long lens that EXIF tells
        (650.0, 1200.0, False),
        (150.0, 155.0, True),  # a fisheye
    ],
)
def test_exif_counts_more_than_what_is_usual(focal_px: float, prior: float | None, likely: bool):
    found = unlikely_focal_lengths(model(focal_px), {} if prior is None else {1: prior})
    assert found == (() if likely else (focal_px,))


def test_all_unlikely_ones_are_given_and_cameras_without_images_do_not_count():
    several = model(150.0, 800.0, 5000.0, 9000.0)
    several.deregister_frame(several.images[4].frame_id)
    assert unlikely_focal_lengths(several, {}) == (150.0, 5000.0)
