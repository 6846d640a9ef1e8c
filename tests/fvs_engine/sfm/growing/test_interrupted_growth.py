"""A growing reconstruction is killed, stopped, and opened again in whatever state its folder is."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from growing_yard import FIRST, NEXT, SETTINGS, Grown, copy_of, model_bytes
from PIL import Image

from fvs_engine.errors import Cancelled, DamagedOutputError, InvalidInputError, StorageError
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.sfm.growing import step as step_module
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.growing.state import GrowthState, ModelChange
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import Finding, FindingCode

KILLED = """
import os, signal, sys
from pathlib import Path
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.settings import SfmSettings
folder, images, stage, *names = sys.argv[1:]
def die(progress):
    if progress.stage == stage and progress.done >= (1 if stage == "registration" else 0):
        os.kill(os.getpid(), signal.SIGKILL)
growing = GrowingReconstruction.open(Path(folder), Path(images), SfmSettings(threads=1), Monitor())
growing.add(names, Monitor(die))
"""


@pytest.mark.parametrize(
    "stage",
    [
        pytest.param("features", marks=pytest.mark.slow),
        pytest.param("matching", marks=pytest.mark.slow),
        "registration",
    ],
)
def test_killed_at_any_stage_it_resumes_to_the_same_model(
    stage: str,
    grown: Grown,
    images: Path,
    tmp_path: Path,
    without_children: Callable[[], AbstractContextManager[None]],
):
    killed = copy_of(grown.bootstrapped, tmp_path)
    command = [sys.executable, "-c", KILLED, str(killed), str(images), stage, NEXT]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    resumed = GrowingReconstruction.open(killed, images, SETTINGS, Monitor())
    assert resumed.generation == 1
    assert resumed.unregistered == (NEXT,)
    with without_children():
        assert resumed.add([NEXT], Monitor()).registered == (NEXT,)
    assert model_bytes(killed) == grown.one_more


def test_a_model_that_was_not_committed_is_forgotten(grown: Grown, images: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    shutil.copytree(folder / "model-000001", folder / "model-000002")
    (folder / ".model.partial").mkdir()
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert growing.generation == 1
    assert not (folder / "model-000002").exists()
    assert not (folder / ".model.partial").exists()
    assert len(growing.reconstruction.views) == len(FIRST)


@pytest.mark.usefixtures("native_here")
def test_warnings_of_an_update_that_was_killed_are_returned_once_more(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """It was committed, and the caller had not saved what it returned."""
    said = Finding.of(FindingCode.UNCALIBRATED)

    def register(_stages: object, state: GrowthState, *_: object) -> ModelChange:
        return ModelChange(state, warnings=(said,))

    monkeypatch.setattr(step_module, "register", register)
    folder = copy_of(grown.bootstrapped, tmp_path)

    def warned() -> list[Finding]:
        growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
        update = growing.add([*FIRST, NEXT], Monitor(), known=grown.first.views)
        return [warning for warning in update.warnings if warning == said]

    assert warned() == warned() == [said]
    GrowingReconstruction.open(folder, images, SETTINGS, Monitor()).acknowledge()
    assert warned() == []


@pytest.mark.parametrize("stage", ["features", pytest.param("registration", marks=pytest.mark.slow)])
def test_it_stops_on_request(stage: str, grown: Grown, images: Path, tmp_path: Path):
    growing = GrowingReconstruction.open(copy_of(grown.bootstrapped, tmp_path), images, SETTINGS, Monitor())
    asked_at = []

    def on_progress(progress: Progress) -> None:
        if progress.stage == stage and not asked_at:
            asked_at.append(time.monotonic())
            monitor.cancel()

    monitor = Monitor(on_progress)
    with pytest.raises(Cancelled):
        growing.add([NEXT], monitor)
    assert time.monotonic() - asked_at[0] < 5.0
    assert growing.generation == 1
    assert len(growing.reconstruction.views) == len(FIRST)


def test_a_changed_photograph_is_named(grown: Grown, images_copy: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    with Image.open(images_copy / "0002.jpg") as image:
        image.convert("RGB").rotate(180).save(images_copy / "0002.jpg", quality=50)
    with pytest.raises(InvalidInputError, match=r"0002\.jpg"):
        GrowingReconstruction.open(folder, images_copy, SETTINGS, Monitor())


def test_files_that_cannot_be_added_are_named(grown: Grown, images_copy: Path, tmp_path: Path):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), images_copy, SETTINGS, Monitor()
    )
    (images_copy / "notes.jpg").write_text("no photograph")
    with pytest.raises(InvalidInputError, match=r"notes\.jpg cannot be read"):
        growing.add(["notes.jpg"], Monitor())
    with pytest.raises(InvalidInputError, match=r"nowhere\.jpg does not exist"):
        growing.add(["nowhere.jpg"], Monitor())
    assert growing.unregistered == ()


def test_photographs_that_left_the_folder_are_taken_out_where_they_may(
    grown: Grown, images_copy: Path, tmp_path: Path
):
    folder = shutil.copytree(grown.bootstrapped, tmp_path / "sfm")
    (images_copy / FIRST[1]).unlink()
    with pytest.raises(InvalidInputError, match=FIRST[1]):
        GrowingReconstruction.open(folder, images_copy, SETTINGS, Monitor())
    for _ in range(2):
        opened = GrowingReconstruction.open(folder, images_copy, SETTINGS, Monitor(), remove_missing=True)
        assert opened.added == (FIRST[0], *FIRST[2:])
        assert sorted(view.name for view in opened.reconstruction.views) == [FIRST[0], *FIRST[2:]]


def test_a_folder_of_other_settings_is_refused(grown: Grown, images: Path):
    with pytest.raises(InvalidInputError, match="other settings"):
        GrowingReconstruction.open(grown.bootstrapped, images, SfmSettings(seed=1), Monitor())
    GrowingReconstruction.open(grown.bootstrapped, images, SfmSettings(threads=2), Monitor())


@pytest.mark.parametrize(("damage", "named"), [("write", "is damaged"), ("unlink", "is missing")])
def test_nothing_is_added_to_or_removed_from_a_damaged_database(
    damage: str, named: str, grown: Grown, images: Path, tmp_path: Path
):
    """The model names its images by the database's ids, so another database does not replace it."""
    folder = copy_of(grown.bootstrapped, tmp_path)
    database = folder / "sfm" / "database.db"
    database.unlink()
    if damage == "write":
        database.write_bytes(b"no database" * 1000)
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    for change in (lambda: growing.add([NEXT], Monitor()), lambda: growing.remove([FIRST[0]])):
        with pytest.raises(DamagedOutputError, match=named) as caught:
            change()
    assert caught.value.hint == f"Delete {folder} and add the images again."
    assert not growing.quarantined


def test_a_damaged_state_is_named(grown: Grown, images: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    state = json.loads((folder / "growth.json").read_text())
    (folder / "growth.json").write_text(json.dumps(state)[:-20])
    with pytest.raises(StorageError, match=r"growth\.json cannot be used: .* It is damaged"):
        GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
