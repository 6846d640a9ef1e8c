"""An image on which pycolmap really crashes: its reduced copy has no width."""

import shutil
from pathlib import Path

import pytest
from PIL import Image

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings
from fvs_schema.findings import Finding, FindingCode

pytestmark = [pytest.mark.process, pytest.mark.slow]
# Only upsampling crashes on the image.
SETTINGS = SfmSettings(threads=1, features_of_few=FeatureSettings(upsample_below_px=1_000_000))
NAMES = [f"{i:04d}.jpg" for i in range(5)]
DEADLY = "0001-deadly.png"


@pytest.fixture
def images(yard_dir: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "images"
    folder.mkdir()
    for name in NAMES:
        shutil.copyfile(yard_dir / "images" / name, folder / name)
    Image.new("1", (32, 200_000)).convert("L").save(folder / DEADLY)
    return folder


def test_a_deadly_image_is_left_out_of_a_new_reconstruction(images: Path, tmp_path: Path):
    names = [NAMES[0], DEADLY, *NAMES[1:4]]
    result = reconstruct(ImageSet(images, names), tmp_path / "sfm", SETTINGS, Monitor())
    assert {view.name for view in result.reconstruction.views} == set(NAMES[:4])
    assert [warning for warning in result.report.warnings if DEADLY in warning.images] == [
        Finding.of(FindingCode.QUARANTINED, [DEADLY], stage="extract", how="signal SIGSEGV")
    ]


def test_a_growing_reconstruction_goes_on_and_forgets_nothing(images: Path, tmp_path: Path):
    folder = tmp_path / "growing"
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    growing.add(NAMES[:4], Monitor())
    update = growing.add([DEADLY, NAMES[4]], Monitor())
    assert set(growing.registered) == set(NAMES)
    assert DEADLY not in update.unregistered
    assert any(DEADLY in warning.images for warning in update.warnings)
    assert set(growing.quarantined) == {DEADLY}

    again = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert set(again.quarantined) == {DEADLY}
    assert again.add([DEADLY], Monitor()).warnings == ()  # it is not even tried

    # A removed image leaves the model; the others keep their poses exactly.
    before = {view.name: view for view in again.reconstruction.views}
    again.remove({NAMES[2], DEADLY})
    after = {view.name: view for view in again.reconstruction.views}
    assert set(after) == set(NAMES) - {NAMES[2]}
    assert all(
        (after[name].camera_from_model.matrix == before[name].camera_from_model.matrix).all()
        for name in after
    )
    assert again.quarantined == {}
    (images / DEADLY).unlink()

    # It can come back, also after another start, and is registered in the same frame.
    returned = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert returned.add([NAMES[2]], Monitor()).registered == (NAMES[2],)
    view = next(view for view in returned.reconstruction.views if view.name == NAMES[2])
    assert abs(view.centre - before[NAMES[2]].centre).max() < 0.05
