import contextlib
import shutil
import sqlite3
import time
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.errors import (
    Cancelled,
    ContradictedModelsError,
    ContradictedPositionsError,
    DamagedOutputError,
    NoImagesError,
    ReconstructionError,
    StorageError,
)
from fvs_engine.geometry import PinholeCamera
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.sfm import stages as stages_module
from fvs_engine.sfm.batch.mapping import MappedModel
from fvs_engine.sfm.batch.reconstruct import SfmResult, model_warnings, reconstruct
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.pose_priors import ImageSet, PosePrior, PosePriors
from fvs_engine.sfm.report import SfmReport
from fvs_engine.sfm.settings import GateSettings, KnownIntrinsics, SfmSettings
from fvs_engine.sfm.verification.gate import JudgedModel
from fvs_schema.findings import Finding, FindingCode

GLOBAL_FIRST = SfmSettings(incremental_first_up_to=0)
"""As for large sets."""


@pytest.fixture
def six(kermit_dir: Path, kermit_names: list[str], tmp_path: Path) -> Path:
    """The first six photographs at half their size, in a folder that the test may change."""
    folder = tmp_path / "six"
    folder.mkdir()
    for name in kermit_names[:6]:
        with Image.open(kermit_dir / name) as image:
            image.resize((320, 240)).save(folder / name, quality=95, exif=image.getexif())
    return folder


def test_kermit_is_registered_whole_by_one_mapper(kermit_sfm: SfmResult, kermit_names: list[str]):
    report = kermit_sfm.report
    assert [view.name for view in kermit_sfm.reconstruction.views] == kermit_names
    assert report.verdict == "accepted"
    assert report.unregistered == ()
    assert [candidate.mapper for candidate in report.candidates] == ["incremental"]
    assert not {"calibration", "global-mapping"} & report.seconds.keys()
    assert report.mean_reprojection_error_px < 1.0
    assert len(kermit_sfm.reconstruction.points) == report.points > 300


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_the_other_mapper_runs_where_the_gate_leaves_doubt(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    doubting = SfmSettings.model_validate({"gate": {"min_match_support": 1}})
    report = reconstruct(ImageSet(kermit_dir, kermit_names), tmp_path / "sfm", doubting, Monitor()).report
    assert "incremental-mapping" not in report.seconds
    assert "calibration" in report.seconds
    assert {candidate.mapper for candidate in report.candidates} == {"incremental", "global"}
    (agreement,) = report.agreements
    assert agreement.median_share < 0.01
    assert report.verdict == "doubtful"
    assert FindingCode.HARDLY_CONFIRMED in {reason.code for reason in report.candidates[0].reasons}


def test_report_survives_json_and_the_model_is_colmaps(kermit_sfm: SfmResult):
    report = kermit_sfm.report
    assert SfmReport.model_validate_json(report.model_dump_json()) == report
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    assert model.num_reg_images() == 11
    assert model.compute_mean_track_length() > 2


def test_a_finished_folder_is_not_computed_again(
    kermit_sfm: SfmResult,
    kermit_dir: Path,
    kermit_names: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    monkeypatch.setattr(stages_module, "run_native", lambda *_args, **_named: pytest.fail("computed again"))
    again = reconstruct(ImageSet(kermit_dir, kermit_names), tmp_path / "sfm", SfmSettings(), Monitor())
    assert again.report == kermit_sfm.report


def test_a_damaged_report_is_written_again(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    (tmp_path / "sfm" / "report.json").write_text('{"mapper": "incre')
    again = reconstruct(ImageSet(kermit_dir, kermit_names), tmp_path / "sfm", SfmSettings(), Monitor())
    assert again.report.registered == kermit_sfm.report.registered
    assert SfmReport.model_validate_json((tmp_path / "sfm" / "report.json").read_text()) == again.report


@pytest.mark.system
def test_wrong_positions_are_named_as_a_possible_cause_and_can_be_left_out(
    kermit_sfm: SfmResult,
    kermit_dir: Path,
    kermit_names: list[str],
    tmp_path: Path,
):
    """As with altitudes of another datum from the eighth photograph on."""
    # Else so many pairs would settle it.
    settings = SfmSettings(gate=GateSettings(min_prior_support=0.4))
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    (tmp_path / "sfm" / "report.json").unlink()
    centres = kermit_sfm.reconstruction.centres()
    spread = centre_spread(np.stack(list(centres.values())))
    wrong = {
        name: PosePrior.at(centres[name] + [0, 0, 2 * spread * (place >= 7)], 0.01 * spread)
        for place, name in enumerate(kermit_names)
    }

    def reconstruct_with(priors: PosePriors) -> SfmReport:
        images = ImageSet(kermit_dir, kermit_names, priors)
        return reconstruct(images, tmp_path / "sfm", settings, Monitor()).report

    with pytest.raises(ContradictedPositionsError) as caught:
        reconstruct_with(PosePriors(by_name=wrong))
    assert "altitude datum" in caught.value.hint
    assert reconstruct_with(PosePriors()).verdict == "accepted"


def test_another_gate_judges_the_same_models_again(
    kermit_sfm: SfmResult,
    kermit_dir: Path,
    kermit_names: list[str],
    tmp_path: Path,
):
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    stages = set()
    strict = SfmSettings.model_validate({"gate": {"min_match_support": 1, "min_doubtful_match_support": 1}})
    monitor = Monitor(lambda progress: stages.add(progress.stage))
    with pytest.raises(ContradictedModelsError, match="contradicts"):
        reconstruct(ImageSet(kermit_dir, kermit_names), tmp_path / "sfm", strict, monitor)
    assert "global-mapping" in stages
    assert "incremental-mapping" not in stages
    assert (tmp_path / "sfm" / "rejected.json").is_file()
    assert not (tmp_path / "sfm" / "report.json").exists()


def cancel_in(stage: str, image_dir: Path, names: list[str], folder: Path) -> float:
    """Start a run, cancel it at the first sign of ``stage``; how long it took to stop, s."""
    asked_at = []

    def on_progress(progress: Progress) -> None:
        if progress.stage == stage and not asked_at:
            asked_at.append(time.monotonic())
            monitor.cancel()

    monitor = Monitor(on_progress)
    with pytest.raises(Cancelled):
        reconstruct(ImageSet(image_dir, names), folder, SfmSettings(), monitor)
    return time.monotonic() - asked_at[0]


def keypoints(folder: Path) -> dict[int, bytes]:
    with contextlib.closing(sqlite3.connect(folder / "database.db")) as database:
        return dict(database.execute("SELECT image_id, data FROM keypoints"))


def test_work_that_is_cancelled_again_and_again_stops_at_once_and_gets_done(
    six: Path, kermit_names: list[str], tmp_path: Path
):
    folder = tmp_path / "sfm"
    for stage in ("features", "matching", "incremental-mapping", "global-mapping"):
        assert cancel_in(stage, six, kermit_names[:6], folder) < 5.0
        assert not (folder / "report.json").exists()
        assert (folder / "mapping" / "incremental").exists() == (stage == "global-mapping")
    result = reconstruct(ImageSet(six, kermit_names[:6]), folder, SfmSettings(), Monitor())
    assert result.report.registered == 6
    assert len(read_colmap(folder / "sparse").views) == 6
    # What was finished before was not done again.
    assert "incremental-mapping" not in result.report.seconds
    assert "matching" not in result.report.seconds


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_added_images_keep_the_features_of_the_old_ones(six: Path, kermit_names: list[str], tmp_path: Path):
    folder = tmp_path / "sfm"
    cancel_in("matching", six, kermit_names[:4], folder)
    before = keypoints(folder)
    result = reconstruct(ImageSet(six, kermit_names[:6]), folder, GLOBAL_FIRST, Monitor())
    after = keypoints(folder)
    assert len(before) == 4
    assert len(after) == 6
    assert all(after[image_id] == data for image_id, data in before.items())
    assert result.report.registered == 6
    assert len({view.camera for view in result.reconstruction.views}) == 1


def test_one_image_is_refused_by_name(kermit_dir: Path, kermit_names: list[str], tmp_path: Path):
    with pytest.raises(NoImagesError, match=kermit_names[0]):
        reconstruct(ImageSet(kermit_dir, kermit_names[:1]), tmp_path, SfmSettings(), Monitor())


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_two_images_that_do_not_overlap_are_named(kermit_copy: Path, data_dir: Path, tmp_path: Path):
    stranger = sorted((data_dir / "fountain-P11" / "images").iterdir())[0]
    with Image.open(stranger) as image:
        image.resize((640, 427)).save(kermit_copy / "stranger.jpg")
    first = min(path.name for path in kermit_copy.iterdir())
    with pytest.raises(ReconstructionError, match=r"stranger\.jpg") as caught:
        reconstruct(
            ImageSet(kermit_copy, [first, "stranger.jpg"]), tmp_path / "sfm", SfmSettings(), Monitor()
        )
    assert "overlap" in caught.value.hint


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_an_image_of_something_else_is_left_out_and_named(
    kermit_sfm: SfmResult, kermit_copy: Path, kermit_names: list[str], data_dir: Path, tmp_path: Path
):
    folder = tmp_path / "sfm"
    shutil.copytree(kermit_sfm.model_dir.parent, folder)  # the stranger joins photographs that are done
    stranger = sorted((data_dir / "fountain-P11" / "images").iterdir())[0]
    with Image.open(stranger) as image:
        image.resize((640, 427)).save(kermit_copy / "stranger.jpg")
    result = reconstruct(
        ImageSet(kermit_copy, [*kermit_names, "stranger.jpg"]), folder, GLOBAL_FIRST, Monitor()
    )
    assert result.report.unregistered == ("stranger.jpg",)
    (warning,) = (found for found in result.report.warnings if "stranger.jpg" in found.images)
    assert warning == Finding.of(FindingCode.UNREGISTERED, ["stranger.jpg"], of=12)
    assert result.report.registered == 11


def test_an_image_without_a_pose_is_warned_of_once():
    centres = {"a.jpg": np.zeros(3), "b.jpg": np.ones(3)}
    names = [*centres, "c.jpg", "d.jpg", "e.jpg", "f.jpg"]
    mapped = MappedModel(
        pycolmap.Reconstruction(),
        JudgedModel("global", centres, None),
        other_components=(("c.jpg",),),
        left_out=("d.jpg",),
        with_few_points=("e.jpg",),
    )
    assert model_warnings(names, mapped) == [
        Finding.of(code, [name], of=6)
        for name, code in {
            "f.jpg": FindingCode.UNREGISTERED,
            "c.jpg": FindingCode.SEPARATE_MODEL,
            "d.jpg": FindingCode.LEFT_OUT,
            "e.jpg": FindingCode.FEW_POINTS,
        }.items()
    ]


def test_walls_without_texture_are_refused_by_name(tmp_path: Path):
    for name in ("wall-1.png", "wall-2.png"):
        Image.new("RGB", (320, 240), (180, 180, 175)).save(tmp_path / name)
    with pytest.raises(ReconstructionError, match=r"texture.*wall-1\.png"):
        reconstruct(
            ImageSet(tmp_path, ["wall-1.png", "wall-2.png"]), tmp_path / "sfm", SfmSettings(), Monitor()
        )


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_images_of_another_size_or_orientation_get_their_own_camera(yard_dir: Path, tmp_path: Path):
    images = tmp_path / "images"
    images.mkdir()
    names = [f"{number:04d}.jpg" for number in range(6)]
    for number, name in enumerate(names):
        with Image.open(yard_dir / "images" / name) as image:
            pixels = image.convert("RGB")
        if number % 3 == 1:
            pixels = pixels.resize((288, 216))
        elif number % 3 == 2:
            pixels = pixels.rotate(90, expand=True)
        pixels.save(images / name, quality=95)
    result = reconstruct(ImageSet(images, names), tmp_path / "sfm", GLOBAL_FIRST, Monitor())
    assert result.report.registered == 6
    sizes = {(view.camera.width, view.camera.height) for view in result.reconstruction.views}
    assert sizes == {(320, 240), (288, 216), (240, 320)}
    assert len({view.camera for view in result.reconstruction.views}) == 3


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_known_intrinsics_stay_as_they_are(six: Path, kermit_names: list[str], tmp_path: Path):
    known = KnownIntrinsics(
        model="PINHOLE", width_px=1280, height_px=960, params=(1389.0, 1389.0, 640.0, 480.0)
    )
    settings = SfmSettings(intrinsics=known)
    result = reconstruct(ImageSet(six, kermit_names[:6]), tmp_path / "sfm", settings, Monitor())
    assert {view.camera for view in result.reconstruction.views} == {
        PinholeCamera(320, 240, 347.25, 347.25, 160.0, 120.0)
    }


def test_a_damaged_database_is_named(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    folder = tmp_path / "sfm"
    shutil.copytree(kermit_sfm.model_dir.parent, folder)
    (folder / "report.json").unlink()
    data = bytearray((folder / "database.db").read_bytes())
    data[:4096] = bytes(4096)
    (folder / "database.db").write_bytes(data)
    with pytest.raises(DamagedOutputError, match=r"database\.db is damaged") as caught:
        reconstruct(ImageSet(kermit_dir, kermit_names), folder, SfmSettings(), Monitor())
    assert "Delete" in caught.value.hint


def test_a_database_that_another_process_holds_is_named(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    folder = tmp_path / "sfm"
    shutil.copytree(kermit_sfm.model_dir.parent, folder)
    other = sqlite3.connect(folder / "database.db")
    try:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StorageError, match="Another process"):
            reconstruct(ImageSet(kermit_dir, kermit_names), folder, SfmSettings(), Monitor())
    finally:
        other.rollback()
        other.close()


def test_centres_are_those_of_colmap(kermit_sfm: SfmResult):
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    for name, centre in kermit_sfm.reconstruction.centres().items():
        np.testing.assert_allclose(centre, model.find_image_with_name(name).projection_center(), atol=1e-12)
