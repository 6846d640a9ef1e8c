"""Images are removed from a growing reconstruction and added again."""

from pathlib import Path

import pycolmap
import pytest
from growing_yard import FIRST, NEXT, SETTINGS, Grown, copy_of

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.database import image_ids
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.stages import SfmFolder


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_images_that_all_left_and_came_back_take_new_ones(grown: Grown, images: Path, tmp_path: Path):
    """The stored result of the first model has image ids that are no longer in the database."""
    folder = copy_of(grown.bootstrapped, tmp_path)
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    growing.remove(FIRST)
    assert growing.registered == ()
    assert set(growing.add(FIRST, Monitor()).registered) == set(FIRST)
    assert growing.model_dir is not None
    model = pycolmap.Reconstruction(growing.model_dir)
    ids = image_ids(SfmFolder(folder / "sfm").database)
    assert {image.name: number for number, image in model.images.items()} == ids
    assert growing.add([NEXT], Monitor()).registered == (NEXT,)
    assert dict(growing.quarantined) == {}


def test_results_with_the_ids_of_images_that_left_are_deleted(grown: Grown, tmp_path: Path):
    folder = SfmFolder(copy_of(grown.bootstrapped, tmp_path) / "sfm")
    assert folder.report.exists()
    assert folder.mapping("incremental").is_dir()
    folder.remove_images(["unknown.jpg"])
    assert folder.report.exists()
    folder.remove_images([FIRST[3]])
    assert not folder.report.exists()
    assert not folder.mapping("incremental").exists()


@pytest.mark.usefixtures("native_here")
def test_a_removal_that_was_killed_is_finished_before_images_are_added(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = copy_of(grown.bootstrapped, tmp_path)
    database = SfmFolder(folder / "sfm").database
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    with monkeypatch.context() as killed:
        killed.setattr(SfmFolder, "remove_images", _killed)
        with pytest.raises(InterruptedError):
            growing.remove([FIRST[3]])
    before = image_ids(database)
    again = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert FIRST[3] not in again.added
    assert again.add([FIRST[3]], Monitor()).registered == (FIRST[3],)
    assert image_ids(database)[FIRST[3]] not in before.values()  # its features were extracted again


def _killed(*_: object) -> None:
    raise InterruptedError
