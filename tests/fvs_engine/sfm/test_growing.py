"""Photographs of kermit are added to a standing model; everything is compared with all of them at once."""

import contextlib
import hashlib
import json
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError, ReconstructionError, StorageError
from fvs_engine.geometry import angle_between, umeyama
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.sfm import stages as stages_module
from fvs_engine.sfm.evidence import centre_spread
from fvs_engine.sfm.growing import GrowingReconstruction, GrowthReport
from fvs_engine.sfm.reconstruct import SfmResult
from fvs_engine.sfm.reconstruction import PosedView, Reconstruction
from fvs_engine.sfm.settings import SfmSettings

SETTINGS = SfmSettings(threads=1)
FIRST = 6
AGREEMENT = 0.01
"""Share of the spread within which test_reconstruct has the two mappers agree on these photographs."""


@dataclass(frozen=True)
class Grown:
    """Six images bootstrapped, four added one by one; the eleventh was only localised."""

    folder: Path
    bootstrapped: Path
    """A copy of the folder as it was after the bootstrap."""
    first: Reconstruction
    last: Reconstruction
    reports: tuple[GrowthReport, ...]
    localised: dict[str, PosedView]
    before_localising: str
    after_localising: str


@pytest.fixture(scope="session")
def grown(kermit_dir: Path, kermit_names: list[str], tmp_path_factory: pytest.TempPathFactory) -> Grown:
    folder = tmp_path_factory.mktemp("grown") / "growing"
    growing = GrowingReconstruction.open(folder, kermit_dir, SETTINGS, Monitor())
    reports = [growing.add(kermit_names[:FIRST], Monitor())]
    first = growing.reconstruction
    bootstrapped = folder.with_name("bootstrapped")
    shutil.copytree(folder, bootstrapped)
    reports += [growing.add([name], Monitor()) for name in kermit_names[FIRST:-1]]
    before = standing_digest(folder)
    localised = growing.localise(kermit_names[-2:], Monitor())
    return Grown(
        folder,
        bootstrapped,
        first,
        growing.reconstruction,
        tuple(reports),
        localised,
        before,
        standing_digest(folder),
    )


def standing_digest(folder: Path) -> str:
    """Of everything that later results depend on."""
    digest = hashlib.sha256()
    for file in sorted([folder / "growth.json", folder / "words.npz", *folder.glob("model-*/*")]):
        digest.update(file.name.encode() + file.read_bytes())
    with contextlib.closing(sqlite3.connect(folder / "sfm" / "database.db")) as database:
        for line in database.iterdump():
            digest.update(line.encode())
    return digest.hexdigest()


def shares_apart(ours: Reconstruction, theirs: Reconstruction) -> np.ndarray:
    """Distances of the centres after Umeyama, in shares of the spread."""
    names = sorted(ours.centres().keys() & theirs.centres().keys())
    source = np.stack([ours.centres()[name] for name in names])
    target = np.stack([theirs.centres()[name] for name in names])
    return np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1) / centre_spread(target)


def copy_of(folder: Path, tmp_path: Path) -> Path:
    return shutil.copytree(folder, tmp_path / "growing")


def test_images_added_one_by_one_stand_where_all_at_once_would(grown: Grown, kermit_sfm: SfmResult):
    apart = shares_apart(grown.last, kermit_sfm.reconstruction)
    assert len(apart) == 10
    assert apart.max() < AGREEMENT
    assert len(grown.last.points) > 0.8 * 10 / 11 * len(kermit_sfm.reconstruction.points)
    assert grown.last.point_errors_px.mean() < 1.0


def test_every_new_point_has_a_colour(grown: Grown):
    assert (grown.last.point_colors.max(axis=1) == 0).mean() <= 0.01


def test_the_model_frame_stays_where_it_is(grown: Grown):
    names = [view.name for view in grown.first.views]
    before = np.stack([grown.first.centres()[name] for name in names])
    after = np.stack([grown.last.centres()[name] for name in names])
    moved = umeyama(before, after)
    assert any(report.refreshed for report in grown.reports)
    assert moved.scale == pytest.approx(1.0, abs=AGREEMENT)
    assert np.degrees(angle_between(moved.rotation, np.eye(3))) < 1.0
    assert np.linalg.norm(after - before, axis=1).max() < 2 * AGREEMENT * centre_spread(before)


def test_an_image_that_cannot_be_registered_waits_until_the_scene_has_grown(
    grown: Grown, kermit_names: list[str]
):
    # 006 shares too little with the first six; 007 ties it to them.
    boot, sixth, seventh, *_ = grown.reports
    assert boot.waiting == ()
    assert sixth.registered == ()
    assert sixth.waiting == (kermit_names[6],)
    assert set(seventh.registered) == set(kermit_names[6:8])
    assert seventh.waiting == ()


def test_what_was_added_is_not_added_again(
    grown: Grown, kermit_dir: Path, kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = copy_of(grown.folder, tmp_path)
    monkeypatch.setattr(stages_module, "run_native", lambda *_args, **_named: pytest.fail("done again"))
    growing = GrowingReconstruction.open(folder, kermit_dir, SETTINGS, Monitor())
    generation = growing.generation
    report = growing.add(kermit_names[:10], Monitor())
    assert report == GrowthReport((), (), False, (), {})
    assert growing.generation == generation
    assert set(growing.registered) == set(kermit_names[:10])


def test_localising_finds_the_camera_that_adding_finds_and_changes_nothing(
    grown: Grown, kermit_dir: Path, kermit_names: list[str], kermit_sfm: SfmResult, tmp_path: Path
):
    assert set(grown.localised) == set(kermit_names[-2:])
    assert grown.before_localising == grown.after_localising
    registered, guest = (grown.localised[name] for name in kermit_names[-2:])
    np.testing.assert_array_equal(registered.centre, grown.last.centres()[registered.name])
    together = Reconstruction(
        (*grown.last.views, guest),
        grown.last.points,
        grown.last.point_colors,
        grown.last.point_errors_px,
    )
    assert shares_apart(together, kermit_sfm.reconstruction).max() < AGREEMENT
    folder = copy_of(grown.folder, tmp_path)
    growing = GrowingReconstruction.open(folder, kermit_dir, SETTINGS, Monitor())
    (again,) = growing.localise([guest.name], Monitor()).values()
    np.testing.assert_array_equal(again.camera_from_model.matrix, guest.camera_from_model.matrix)


def test_strangers_and_collages_are_neither_localised_nor_registered(
    grown: Grown, kermit_copy: Path, data_dir: Path, tmp_path: Path
):
    (stranger,) = strangers(data_dir, kermit_copy, 1)
    # Half of the matches of a collage say that it was taken here, half that it was taken there.
    with Image.open(kermit_copy / "kermit000.jpg") as image:
        collage = image.convert("RGB")
    with Image.open(kermit_copy / "kermit003.jpg") as image:
        collage.paste(image.crop((320, 0, 640, 480)), (320, 0))
    collage.save(kermit_copy / "collage.jpg", quality=95)
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), kermit_copy, SETTINGS, Monitor()
    )
    names = ["collage.jpg", stranger]
    assert growing.localise(names, Monitor()) == {}
    report = growing.add(names, Monitor())
    assert report.registered == ()
    assert report.waiting == tuple(names)
    (warning,) = report.warnings
    assert "collage.jpg is not taken in" in warning
    assert growing.generation == 1


def test_an_image_of_another_camera_finds_its_place_too(
    grown: Grown, kermit_copy: Path, kermit_names: list[str], kermit_sfm: SfmResult, tmp_path: Path
):
    with Image.open(kermit_copy / kermit_names[-1]) as image:
        image.convert("RGB").resize((512, 384)).save(kermit_copy / kermit_names[-1], quality=95)
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), kermit_copy, SETTINGS, Monitor())
    (guest,) = growing.localise(kermit_names[-1:], Monitor()).values()
    assert growing.add(kermit_names[-1:], Monitor()).registered == (kermit_names[-1],)
    added = growing.reconstruction.views[-1]
    assert (guest.camera.width, added.camera.width) == (512, 512)
    # One image alone says less of its focal length, and so of its distance, than many of one camera.
    spread = centre_spread(np.stack(list(kermit_sfm.reconstruction.centres().values())))
    assert shares_apart(growing.reconstruction, kermit_sfm.reconstruction).max() < 2 * AGREEMENT
    assert np.linalg.norm(guest.centre - added.centre) < 5 * AGREEMENT * spread


def strangers(data_dir: Path, folder: Path, count: int) -> list[str]:
    """Photographs of other places, each of another one."""
    places = ("fountain-P11", "castle-P19", "brighton", "banana")
    names = []
    for number, place in enumerate(places[:count]):
        names.append(f"stranger-{number}.jpg")
        with Image.open(min((data_dir / place / "images").iterdir())) as image:
            image.convert("RGB").resize((640, 427)).save(folder / names[-1])
    return names


def test_first_images_that_do_not_overlap_are_refused_and_wait_for_better_ones(
    kermit_copy: Path, kermit_names: list[str], data_dir: Path, tmp_path: Path
):
    names = strangers(data_dir, kermit_copy, 3)
    growing = GrowingReconstruction.open(tmp_path / "growing", kermit_copy, SETTINGS, Monitor())
    assert growing.add(names[:1], Monitor()).waiting == (names[0],)
    with pytest.raises(ReconstructionError, match="No two of the 3 images") as caught:
        growing.add(names, Monitor())
    assert "overlap" in caught.value.hint
    assert growing.registered == ()
    assert growing.reconstruction.views == ()
    assert growing.localise(kermit_names[:1], Monitor()) == {}
    report = growing.add(kermit_names[:4], Monitor())
    assert report.registered == tuple(kermit_names[:4])
    assert report.waiting == tuple(names)


KILLED = """
import os, signal, sys
from pathlib import Path
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.growing import GrowingReconstruction
from fvs_engine.sfm.settings import SfmSettings
folder, images, stage, *names = sys.argv[1:]
def die(progress):
    if progress.stage == stage and progress.done >= (1 if stage == "registration" else 0):
        os.kill(os.getpid(), signal.SIGKILL)
growing = GrowingReconstruction.open(Path(folder), Path(images), SfmSettings(threads=1), Monitor())
growing.add(names, Monitor(die))
"""


def model_bytes(folder: Path) -> dict[str, bytes]:
    (model,) = folder.glob("model-*")
    return {file.name: file.read_bytes() for file in model.iterdir()}


def test_killed_at_any_stage_it_resumes_to_the_same_model(
    grown: Grown, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    names = kermit_names[FIRST : FIRST + 2]
    clean = shutil.copytree(grown.bootstrapped, tmp_path / "clean")
    GrowingReconstruction.open(clean, kermit_dir, SETTINGS, Monitor()).add(names, Monitor())
    killed = shutil.copytree(grown.bootstrapped, tmp_path / "killed")
    for stage in ("features", "matching", "registration"):
        command = [sys.executable, "-c", KILLED, str(killed), str(kermit_dir), stage, *names]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
        resumed = GrowingReconstruction.open(killed, kermit_dir, SETTINGS, Monitor())
        assert resumed.generation == 1
        assert resumed.waiting == tuple(names)
    report = resumed.add(names, Monitor())
    assert set(report.registered) == set(names)
    assert model_bytes(killed) == model_bytes(clean)


def test_a_model_that_was_not_committed_is_forgotten(grown: Grown, kermit_dir: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    shutil.copytree(folder / "model-000001", folder / "model-000002")
    (folder / ".model.partial").mkdir()
    growing = GrowingReconstruction.open(folder, kermit_dir, SETTINGS, Monitor())
    assert growing.generation == 1
    assert not (folder / "model-000002").exists()
    assert not (folder / ".model.partial").exists()
    assert len(growing.reconstruction.views) == FIRST


@pytest.mark.parametrize("stage", ["matching", "registration"])
def test_it_stops_on_request_and_goes_on(
    stage: str, grown: Grown, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), kermit_dir, SETTINGS, Monitor()
    )
    asked_at = []

    def on_progress(progress: Progress) -> None:
        if progress.stage == stage and not asked_at:
            asked_at.append(time.monotonic())
            monitor.cancel()

    monitor = Monitor(on_progress)
    with pytest.raises(Cancelled):
        growing.add(kermit_names[FIRST : FIRST + 2], monitor)
    assert time.monotonic() - asked_at[0] < 5.0
    assert growing.generation == 1
    assert len(growing.reconstruction.views) == FIRST


def test_a_changed_photograph_is_named(grown: Grown, kermit_copy: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    with Image.open(kermit_copy / "kermit002.jpg") as image:
        image.convert("RGB").rotate(180).save(kermit_copy / "kermit002.jpg", quality=50)
    with pytest.raises(InvalidInputError, match=r"kermit002\.jpg"):
        GrowingReconstruction.open(folder, kermit_copy, SETTINGS, Monitor())


def test_files_that_cannot_be_added_are_named(grown: Grown, kermit_copy: Path, tmp_path: Path):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), kermit_copy, SETTINGS, Monitor()
    )
    (kermit_copy / "notes.jpg").write_text("no photograph")
    with pytest.raises(InvalidInputError, match=r"notes\.jpg cannot be read"):
        growing.add(["notes.jpg"], Monitor())
    with pytest.raises(InvalidInputError, match=r"nowhere\.jpg does not exist"):
        growing.add(["nowhere.jpg"], Monitor())
    with pytest.raises(InvalidInputError, match="white space"):
        growing.add(["ker mit.jpg"], Monitor())
    assert growing.waiting == ()


def test_a_folder_of_other_settings_is_refused(grown: Grown, kermit_dir: Path):
    with pytest.raises(InvalidInputError, match="other settings"):
        GrowingReconstruction.open(grown.bootstrapped, kermit_dir, SfmSettings(seed=1), Monitor())
    GrowingReconstruction.open(grown.bootstrapped, kermit_dir, SfmSettings(threads=2), Monitor())


def test_a_damaged_state_is_named(grown: Grown, kermit_dir: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    state = json.loads((folder / "growth.json").read_text())
    (folder / "growth.json").write_text(json.dumps(state)[:-20])
    with pytest.raises(StorageError, match=r"growth\.json is damaged"):
        GrowingReconstruction.open(folder, kermit_dir, SETTINGS, Monitor())
