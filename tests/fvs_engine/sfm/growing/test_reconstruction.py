"""Images are added to a model; their true positions are known exactly."""

import contextlib
import hashlib
import json
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled, InvalidInputError, ReconstructionError, StorageError
from fvs_engine.geometry import angle_between, umeyama
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.sfm import stages as stages_module
from fvs_engine.sfm.colmap.imports import import_transforms_json
from fvs_engine.sfm.growing import reconstruction as reconstruction_module
from fvs_engine.sfm.growing import registration as registration_module
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.growing.registration import ModelChange
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.growing.veto import Veto, veto
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.views import AnyView

SETTINGS = SfmSettings(threads=1)
NAMES = [f"{i:04d}.jpg" for i in range(9)]
FIRST, NEXT, FAR, BETWEEN, NEVER = NAMES[:4], NAMES[4], NAMES[7], NAMES[5:7], NAMES[8]
AGREEMENT = 0.02
"""Share of the spread: so small photographs hold a camera less firmly than those that are meant."""


@dataclass(frozen=True)
class Grown:
    """Four images bootstrapped, one added, one too far away, the two between; another only localised."""

    folder: Path
    bootstrapped: Path
    """A copy of the folder as it was after the bootstrap."""
    one_more: dict[str, bytes]
    """The model's files with the first image that was added."""
    first: Reconstruction
    last: Reconstruction
    updates: tuple[PoseUpdate, ...]
    localised: dict[str, AnyView]
    before_localising: str
    after_localising: str


@pytest.fixture(scope="session")
def images(yard_dir: Path) -> Path:
    """Read-only."""
    return yard_dir / "images"


@pytest.fixture
def images_copy(images: Path, tmp_path: Path) -> Path:
    """The same photographs in a folder that the test may change."""
    return shutil.copytree(images, tmp_path / "images")


@pytest.fixture(scope="session")
def truth(yard_dir: Path) -> Reconstruction:
    return import_transforms_json(yard_dir / "transforms.json")


@pytest.fixture(scope="session")
def grown(
    images: Path,
    tmp_path_factory: pytest.TempPathFactory,
    without_children: Callable[[], AbstractContextManager[None]],
) -> Grown:
    with without_children():
        return grow(images, tmp_path_factory.mktemp("grown") / "growing")


def grow(images: Path, folder: Path) -> Grown:
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    updates = [growing.add(FIRST, Monitor())]
    first = growing.reconstruction
    bootstrapped = folder.with_name("bootstrapped")
    shutil.copytree(folder, bootstrapped)
    updates.append(growing.add([NEXT], Monitor()))
    one_more = model_bytes(folder)
    updates += [growing.add([FAR], Monitor()), growing.add(BETWEEN, Monitor())]
    before = state_digest(folder)
    localised = growing.localise([FAR, NEVER], Monitor())
    return Grown(
        folder,
        bootstrapped,
        one_more,
        first,
        growing.reconstruction,
        tuple(updates),
        localised,
        before,
        state_digest(folder),
    )


def state_digest(folder: Path) -> str:
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
    known = {Path(name).name: centre for name, centre in theirs.centres().items()}
    names = sorted(ours.centres().keys() & known.keys())
    source = np.stack([ours.centres()[name] for name in names])
    target = np.stack([known[name] for name in names])
    return np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1) / centre_spread(target)


def copy_of(folder: Path, tmp_path: Path) -> Path:
    return shutil.copytree(folder, tmp_path / "growing")


def test_added_images_are_registered_where_they_were_taken(grown: Grown, truth: Reconstruction):
    assert [view.name for view in grown.last.views] == NAMES[:8]
    assert shares_apart(grown.last, truth).max() < AGREEMENT
    assert len(grown.last.points) > 1.5 * len(grown.first.points)
    assert grown.last.point_errors_px.mean() < 1.0


def test_every_new_point_has_a_colour(grown: Grown):
    assert (grown.last.points.colors.max(axis=1) == 0).mean() <= 0.01


def test_the_model_frame_does_not_move(grown: Grown):
    names = [view.name for view in grown.first.views]
    before = np.stack([grown.first.centres()[name] for name in names])
    after = np.stack([grown.last.centres()[name] for name in names])
    moved = umeyama(before, after)
    assert set(names) <= grown.updates[3].moved  # by global bundle adjustment
    assert moved.scale == pytest.approx(1.0, abs=AGREEMENT)
    assert np.degrees(angle_between(moved.rotation, np.eye(3))) < 1.0
    assert np.linalg.norm(after - before, axis=1).max() < 2 * AGREEMENT * centre_spread(before)


@pytest.mark.usefixtures("native_here")
def test_many_new_images_are_reconstructed_with_the_first_ones_in_their_frame(
    grown: Grown, images: Path, truth: Reconstruction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, stages, tested = copy_of(grown.bootstrapped, tmp_path), set[str](), list[Sequence[str]]()

    def veto_of(run: stages_module.Stages, model_dir: Path, names: Sequence[str], priors: PosePriors) -> Veto:
        tested.append(names)
        return veto(run, model_dir, names, priors)

    monkeypatch.setattr(reconstruction_module, "veto", veto_of)
    vocabulary_of_first = (folder / "words.npz").read_bytes()
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    update = growing.add(NAMES, Monitor(lambda progress: stages.add(progress.stage)))
    assert "incremental mapping" in stages
    assert "registration" not in stages
    assert set(update.registered) == set(NAMES) - set(FIRST)
    assert [set(names) for names in tested] == [set(NAMES) - set(FIRST)]
    assert shares_apart(growing.reconstruction, truth).max() < AGREEMENT
    before, after = grown.first.centres(), growing.reconstruction.centres()
    spread = centre_spread(np.stack(list(after.values())))
    assert max(np.linalg.norm(after[name] - before[name]) for name in FIRST) < 2 * AGREEMENT * spread
    again = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert again.add(NAMES, Monitor()).registered == ()
    assert (folder / "words.npz").read_bytes() != vocabulary_of_first


def test_an_image_that_cannot_be_registered_is_tried_again_when_the_scene_has_grown(grown: Grown):
    boot, near, far, between = grown.updates
    assert set(boot.registered) == set(FIRST)
    assert (near.registered, near.unregistered) == ((NEXT,), ())
    assert (far.registered, far.unregistered) == ((), (FAR,))
    assert set(between.registered) == {*BETWEEN, FAR}
    assert between.unregistered == ()


def test_nothing_is_said_of_an_image_that_a_remap_registers_after_all(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    growing = GrowingReconstruction.open(copy_of(grown.bootstrapped, tmp_path), images, SETTINGS, Monitor())

    def register(
        _stages: object, _images: object, state: GrowthState, *_: object, **__: object
    ) -> ModelChange:
        return ModelChange(state, warnings=tuple(f"{name} is not registered: x." for name in [NEXT, FAR]))

    def remap(_stages: object, _images: object, state: GrowthState, *_: object) -> ModelChange:
        posed = [*state.registered, NEXT]
        return ModelChange(state.with_poses(posed, len(posed), state.adjusted_points), mapper="global")

    monkeypatch.setattr(reconstruction_module, "register", register)
    monkeypatch.setattr(reconstruction_module, "remap", remap)
    monkeypatch.setattr(reconstruction_module, "reason_to_remap", lambda *_: "It is due.")
    update = growing.add([NEXT, FAR], Monitor())
    assert update.warnings[0] == f"{FAR} is not registered: x."
    assert not any(line.startswith(NEXT) for line in update.warnings)


@pytest.mark.parametrize(("sigma_share", "asked"), [(0.01, []), (1.0, [NEVER])])
def test_priors_too_inaccurate_to_judge_poses_leave_that_to_the_witness(
    sigma_share: float,
    asked: list[str],
    grown: Grown,
    images: Path,
    truth: Reconstruction,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    without_children: Callable[[], AbstractContextManager[None]],
):
    centres = {Path(name).name: centre for name, centre in truth.centres().items()}
    sigma = sigma_share * centre_spread(np.stack(list(centres.values())))
    priors = PosePriors(by_name={name: PosePrior.at(centres[name], sigma) for name in NAMES})
    named: list[str] = []
    monkeypatch.setattr(registration_module, "ask_witness", lambda *given: named.extend(given[2]))
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images, SETTINGS, Monitor())
    with without_children():
        growing.add([NEVER], Monitor(), priors)
    assert named == asked


def test_what_was_added_is_not_added_again(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = copy_of(grown.folder, tmp_path)
    monkeypatch.setattr(stages_module, "run_native", lambda *_args, **_named: pytest.fail("done again"))
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    generation = growing.generation
    update = growing.add(NAMES[:8], Monitor())
    assert (update.registered, update.unregistered, update.warnings, update.seconds) == ((), (), (), {})
    assert update.lost == update.moved == frozenset()
    assert [view.name for view in update.views] == NAMES[:8]
    assert growing.generation == generation
    assert set(growing.registered) == set(NAMES[:8])


def test_localising_finds_where_an_image_was_taken_and_changes_nothing(
    grown: Grown, images: Path, truth: Reconstruction, tmp_path: Path
):
    assert set(grown.localised) == {FAR, NEVER}
    assert grown.before_localising == grown.after_localising
    np.testing.assert_array_equal(grown.localised[FAR].centre, grown.last.centres()[FAR])
    guest = grown.localised[NEVER]
    together = Reconstruction((*grown.last.views, guest), grown.last.points, grown.last.point_errors_px)
    assert shares_apart(together, truth).max() < AGREEMENT
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images, SETTINGS, Monitor())
    (again,) = growing.localise([NEVER], Monitor()).values()
    np.testing.assert_array_equal(again.camera_from_model.matrix, guest.camera_from_model.matrix)


@pytest.fixture
def misleading(images_copy: Path) -> list[str]:
    """A collage, and a photograph of another place, among the photographs."""
    # Half of the matches of a collage say that it was taken here, half that it was taken there.
    with Image.open(images_copy / NAMES[0]) as image:
        collage = image.convert("RGB")
    with Image.open(images_copy / NAMES[2]) as image:
        collage.paste(image.crop((160, 0, 320, 240)), (160, 0))
    collage.save(images_copy / "collage.jpg", quality=95)
    return ["collage.jpg", *strangers(images_copy, 1)]


@pytest.mark.usefixtures("native_here")
def test_strangers_and_collages_are_not_registered(
    grown: Grown, images_copy: Path, misleading: list[str], tmp_path: Path
):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), images_copy, SETTINGS, Monitor()
    )
    update = growing.add(misleading, Monitor())
    assert update.registered == ()
    assert update.unregistered == tuple(misleading)
    (warning,) = update.warnings
    assert "collage.jpg is not registered" in warning
    assert growing.generation == 1


@pytest.mark.slow
def test_strangers_and_collages_are_not_localised(
    grown: Grown, images_copy: Path, misleading: list[str], tmp_path: Path
):
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images_copy, SETTINGS, Monitor())
    assert growing.localise(misleading, Monitor()) == {}


@pytest.mark.slow
def test_an_image_of_another_camera_is_registered_too(
    grown: Grown, images_copy: Path, truth: Reconstruction, tmp_path: Path
):
    with Image.open(images_copy / NEVER) as image:
        image.convert("RGB").resize((288, 216)).save(images_copy / NEVER, quality=95)
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images_copy, SETTINGS, Monitor())
    (guest,) = growing.localise([NEVER], Monitor()).values()
    assert growing.add([NEVER], Monitor()).registered == (NEVER,)
    added = growing.reconstruction.views[-1]
    assert (guest.camera.width, added.camera.width) == (288, 288)
    # One image alone says less of its focal length, and so of its distance, than many of one camera.
    spread = centre_spread(np.stack(list(grown.last.centres().values())))
    assert shares_apart(growing.reconstruction, truth).max() < 2 * AGREEMENT
    assert np.linalg.norm(guest.centre - added.centre) < 5 * AGREEMENT * spread


def strangers(folder: Path, count: int) -> list[str]:
    """Photographs of synthetic places, a different one each."""
    camera = SimulatedCamera.like_a_drone(320, 240)
    names = [f"stranger-{number}.jpg" for number in range(count)]
    for number, name in enumerate(names):
        place = folder / "strangers" / str(number)
        (photograph,) = write_photographs(place, courtyard(100 + number), camera, orbit(1), Monitor())
        photograph.replace(folder / name)
    return names


@pytest.mark.usefixtures("native_here")
def test_first_images_that_do_not_overlap_support_no_model(tmp_path: Path):
    names = strangers(tmp_path, 3)
    growing = GrowingReconstruction.open(tmp_path / "growing", tmp_path, SETTINGS, Monitor())
    assert growing.add(names[:1], Monitor()).unregistered == (names[0],)
    with pytest.raises(ReconstructionError, match="3 images") as caught:
        growing.add(names, Monitor())
    assert "overlap" in caught.value.hint
    assert growing.registered == ()
    assert growing.unregistered == tuple(names)
    assert growing.reconstruction.views == ()
    assert growing.localise(names[:1], Monitor()) == {}


@pytest.mark.slow
def test_first_images_without_a_model_are_tried_again_with_better_ones(images_copy: Path, tmp_path: Path):
    names = strangers(images_copy, 3)
    growing = GrowingReconstruction.open(tmp_path / "growing", images_copy, SETTINGS, Monitor())
    with pytest.raises(ReconstructionError):
        growing.add(names, Monitor())
    update = growing.add(FIRST, Monitor())
    assert update.registered == tuple(FIRST)
    assert update.unregistered == tuple(names)


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


def model_bytes(folder: Path) -> dict[str, bytes]:
    (model,) = folder.glob("model-*")
    return {file.name: file.read_bytes() for file in model.iterdir()}


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
        opened = GrowingReconstruction.open(folder, images_copy, SETTINGS, Monitor(), leaving=True)
        assert opened.added == (FIRST[0], *FIRST[2:])
        assert sorted(view.name for view in opened.reconstruction.views) == [FIRST[0], *FIRST[2:]]


def test_a_folder_of_other_settings_is_refused(grown: Grown, images: Path):
    with pytest.raises(InvalidInputError, match="other settings"):
        GrowingReconstruction.open(grown.bootstrapped, images, SfmSettings(seed=1), Monitor())
    GrowingReconstruction.open(grown.bootstrapped, images, SfmSettings(threads=2), Monitor())


def test_a_damaged_state_is_named(grown: Grown, images: Path, tmp_path: Path):
    folder = copy_of(grown.bootstrapped, tmp_path)
    state = json.loads((folder / "growth.json").read_text())
    (folder / "growth.json").write_text(json.dumps(state)[:-20])
    with pytest.raises(StorageError, match=r"growth\.json cannot be used: .* It is damaged"):
        GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
