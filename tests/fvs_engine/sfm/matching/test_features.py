from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image
from PIL.ExifTags import IFD

from fvs_engine.choices import CameraModel
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import gps_positions, image_cameras, image_ids, remove_images
from fvs_engine.sfm.jobs import ExtractFeatures
from fvs_engine.sfm.matching.features import add_features, import_images
from fvs_engine.sfm.settings import FeatureSettings, FocalPrior, SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages

pytestmark = pytest.mark.usefixtures("all_native_here")

EXIF_IFD, FOCAL_LENGTH_35MM = 0x8769, 0xA405
PRIOR = FocalPrior(focal_length_px=2001.3, width_px=1600)
"""Between two whole millimetres of a 35 mm equivalent, which is all that EXIF could hold of it."""


def save(file: Path, focal_35mm: int | None = None, size: tuple[int, int] = (64, 48)) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    exif = Image.Exif()
    if focal_35mm is not None:
        exif.get_ifd(EXIF_IFD)[FOCAL_LENGTH_35MM] = focal_35mm
    Image.fromarray(pixels).save(file, exif=exif)


def imported(folder: Path, settings: SfmSettings) -> Mapping[str, pycolmap.Camera]:
    """Name → camera in the database."""
    stages = Stages(SfmFolder(folder / "sfm"), folder, settings, Monitor())
    stages.folder.root.mkdir(exist_ok=True)
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    import_images(stages, names)
    with pycolmap.Database.open(stages.folder.database) as database:
        return {
            name: database.read_camera(camera_id)
            for name, camera_id in image_cameras(stages.folder.database).items()
        }


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV"])
def test_the_focal_length_prior_is_the_camera_of_images_without_exif(tmp_path: Path, model: CameraModel):
    save(tmp_path / "a.jpg")
    save(tmp_path / "b.png")
    cameras = imported(tmp_path, SfmSettings(camera_model=model, focal_prior=PRIOR))
    first, second = cameras["a.jpg"], cameras["b.png"]
    assert first.camera_id == second.camera_id
    assert first.model_name == model
    assert first.has_prior_focal_length
    assert first.mean_focal_length() == 2001.3 * 64 / 1600
    assert (first.principal_point_x, first.principal_point_y) == (32.0, 24.0)
    assert not np.any(first.params[3 if model == "SIMPLE_RADIAL" else 4 :])


def test_without_a_prior_the_focal_length_is_a_guess(tmp_path: Path):
    save(tmp_path / "a.jpg")
    assert not imported(tmp_path, SfmSettings())["a.jpg"].has_prior_focal_length


def test_exif_precedes_the_prior_and_images_of_equal_focal_length_share_a_camera(tmp_path: Path):
    save(tmp_path / "a.jpg")
    save(tmp_path / "b.jpg", focal_35mm=43)  # 80.05 px: the prior is 79.5
    save(tmp_path / "c.jpg", focal_35mm=24)
    save(tmp_path / "d.jpg", size=(32, 24))
    save(tmp_path / "e.jpg")
    settings = SfmSettings(focal_prior=FocalPrior(focal_length_px=79.5, width_px=64))
    cameras = imported(tmp_path, settings)
    ids = {name: camera.camera_id for name, camera in cameras.items()}
    assert ids["a.jpg"] == ids["b.jpg"] == ids["e.jpg"]
    assert len({ids["a.jpg"], ids["c.jpg"], ids["d.jpg"]}) == 3
    assert cameras["a.jpg"].mean_focal_length() == 79.5
    assert cameras["c.jpg"].mean_focal_length() == pytest.approx(80.0 * 24 / 43.27, rel=0.01)
    assert cameras["d.jpg"].mean_focal_length() == 79.5 / 2
    save(tmp_path / "f.jpg")
    assert imported(tmp_path, settings)["f.jpg"].camera_id == ids["a.jpg"]


def test_one_more_image_has_no_other_opened_unless_it_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    open_image = Image.open

    def observed(file: Path) -> Image.Image:
        opened.append(file.name)
        return open_image(file)

    monkeypatch.setattr("fvs_engine.sfm.matching.features.Image.open", observed)
    save(tmp_path / "a.jpg")
    imported(tmp_path, SfmSettings())
    save(tmp_path / "b.jpg")
    imported(tmp_path, SfmSettings())
    assert opened == ["a.jpg", "b.jpg"]
    save(tmp_path / "b.jpg", focal_35mm=43)
    save(tmp_path / "c.jpg", focal_35mm=43)
    cameras = imported(tmp_path, SfmSettings())
    assert opened[2:] == ["b.jpg", "c.jpg"]
    assert cameras["c.jpg"].camera_id == cameras["b.jpg"].camera_id


@pytest.mark.parametrize(
    ("reduced_to_px", "small"), [(1600, {"small.png"}), (120, {"small.png", "large.png"})]
)
def test_only_small_images_are_upsampled_for_their_features(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reduced_to_px: int, small: set[str]
):
    save(tmp_path / "large.png", size=(200, 150))
    save(tmp_path / "small.png", size=(100, 75))
    upsampled: dict[str, bool] = {}

    native_over = Stages.native_over

    def observed(stages: Stages, names: list[str], request_of: Any, **options: Any) -> Any:
        request = request_of(names)
        if isinstance(request, ExtractFeatures):
            upsampled.update(dict.fromkeys(names, request.upsampled))
        return native_over(stages, names, request_of, **options)

    monkeypatch.setattr(Stages, "native_over", observed)
    few = FeatureSettings(max_image_size_px=reduced_to_px, upsample_below_px=150)
    settings = SfmSettings(features_of_few=few)
    stages = Stages(SfmFolder(tmp_path / "sfm"), tmp_path, settings, Monitor())
    stages.folder.root.mkdir()
    add_features(stages, ["large.png", "small.png"])
    assert {name for name, was in upsampled.items() if was} == small
    assert upsampled.keys() == {"large.png", "small.png"}


@pytest.mark.parametrize(("count", "given", "few"), [(3, False, True), (4, False, False), (4, True, True)])
def test_images_of_a_large_set_are_reduced_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, given: bool, few: bool
):
    names = [f"{number}.png" for number in range(count)]
    for name in names:
        save(tmp_path / name, size=(200, 150))
    asked: list[ExtractFeatures] = []
    native_over = Stages.native_over

    def observed(stages: Stages, names: list[str], request_of: Any, **options: Any) -> Any:
        request = request_of(names)
        if isinstance(request, ExtractFeatures):
            asked.append(request)
        return native_over(stages, names, request_of, **options)

    monkeypatch.setattr(Stages, "native_over", observed)
    settings = SfmSettings(exhaustive_up_to=3)
    stages = Stages(SfmFolder(tmp_path / "sfm"), tmp_path, settings, Monitor())
    stages.folder.root.mkdir()
    add_features(stages, names, settings.features_of_few if given else None)
    expected = settings.features_of_few if few else settings.features_of_many
    assert [(one.max_image_size_px, one.max_features) for one in asked] == [
        (expected.max_image_size_px, expected.max_features)
    ]


def test_what_a_mask_leaves_out_has_no_features(tmp_path: Path) -> None:
    for name in ("masked.png", "whole.png"):
        save(tmp_path / name, size=(320, 240))
    counts = np.ones((240, 320), dtype=bool)
    counts[:, 100:] = False
    (tmp_path / "masks").mkdir()
    Image.fromarray(counts).save(tmp_path / "masks" / "masked.png")

    def features() -> dict[str, np.ndarray]:
        stages = Stages(SfmFolder(tmp_path / "sfm"), tmp_path, SfmSettings(), Monitor())
        names = stages.open(["masked.png", "whole.png"], 2)
        add_features(stages, names)
        ids = image_ids(stages.folder.database)
        with pycolmap.Database.open(stages.folder.database) as database:
            return {name: database.read_keypoints(ids[name])[:, :2] for name in names}

    first = features()
    assert 20 < len(first["masked.png"]) < len(first["whole.png"])
    assert first["masked.png"][:, 0].max() <= 101
    Image.fromarray(~counts).save(tmp_path / "masks" / "masked.png")
    second = features()
    assert second["masked.png"][:, 0].min() >= 99
    np.testing.assert_array_equal(first["whole.png"], second["whole.png"])
    (tmp_path / "masks" / "masked.png").unlink()
    np.testing.assert_array_equal(features()["masked.png"], first["whole.png"])


def gps(latitude: tuple[float, ...], altitude_m: float | None = 100.0) -> bytes:
    tags = {1: "N", 2: latitude, 3: "E", 4: (7.0, 30.0, 0.0), 5: b"\0", 6: altitude_m}
    exif = Image.Exif()
    exif.get_ifd(IFD.GPSInfo).update({tag: value for tag, value in tags.items() if value is not None})
    return exif.tobytes()


def test_positions_in_metadata_are_those_that_the_upload_has_too(tmp_path: Path):
    grey = Image.new("RGB", (64, 48))
    packet = b'<d GpsLatitude="48.002" GpsLongitude="7.5" AbsoluteAltitude="+130.0">'
    grey.save(tmp_path / "a.jpg", exif=gps((48.0, 0.0, 0.0)))
    grey.save(tmp_path / "b.png", exif=gps((48.0, 0.06)))
    grey.save(tmp_path / "c.jpg", xmp=packet)
    grey.save(tmp_path / "d.jpg", exif=gps((48.0, 0.0, 0.0), None))
    grey.save(tmp_path / "e.jpg")
    imported(tmp_path, SfmSettings())
    database = tmp_path / "sfm" / "database.db"
    ids = image_ids(database)
    found = gps_positions(database)
    assert list(found) == [ids["a.jpg"], ids["b.png"], ids["c.jpg"]]
    assert np.stack(list(found.values())) == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [0.0, 111.2, 0.0], [0.0, 222.4, 30.0]]), abs=0.1
    )
    remove_images(database, ["a.jpg"])
    assert list(gps_positions(database)) == [ids["b.png"], ids["c.jpg"]]
    imported(tmp_path, SfmSettings())
    assert len(gps_positions(database)) == 3
