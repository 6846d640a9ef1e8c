"""The program on real photographs, from start to end."""

import json
import os
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image
from quick_reconstruction import OPTIONS

from fvs_engine.cli.exit_codes import EXIT_CODES
from fvs_engine.errors import Cancelled
from fvs_engine.sfm import stages
from fvs_engine.splat.ply import read_ply

pytestmark = pytest.mark.usefixtures("all_native_here")
Fvs = Callable[..., Any]
FvsUntil = Callable[..., tuple[int, str]]
FvsCommand = Callable[..., list[str]]


def test_good_photographs_are_used_and_bad_ones_are_named(first_run: tuple[Path, Any]) -> None:
    _, run = first_run
    assert run.status == 0, run.stderr
    images = run.document["manifest"]["images"]
    assert len(images["photographs"]) == 11
    reasons = {image["name"]: image["reason"] for image in images["rejected"]}
    assert set(reasons) == {"the first again %E9.jpg", "cut off %E9.jpg", "letter.jpg"}
    assert "more of them/f%FCr den Druck.jpg" in {image["name"] for image in images["photographs"]}
    warnings = [json.loads(line).get("warning", {}) for line in run.stderr.splitlines()]
    unusable = [warning for warning in warnings if warning.get("code") == "unusable-photograph"]
    for name, reason in reasons.items():
        assert any(warning["images"] == [name] and reason in warning["message"] for warning in unusable)


def test_the_photographs_are_registered_and_learned(first_run: tuple[Path, Any]) -> None:
    out, run = first_run
    info = run.document
    cameras = info["manifest"]["cameras"]
    assert len(cameras["registered"]) >= 9
    assert info["stage"] == "finished"
    assert info["metrics"]["iterations"] == 120
    # A black image of these photographs has about 8 dB, their mean colour about 11 dB.
    assert info["metrics"]["psnr_db"] > 13
    assert len(read_ply(out / "splat" / "point_cloud.ply")) == info["metrics"]["gaussians"]


def test_a_mask_goes_where_its_photograph_goes(
    fvs: Fvs, photographs: Path, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    out, run = first_run
    (masked,) = (image for image in run.document["manifest"]["images"]["photographs"] if image["masked"])
    name = masked["normalised_name"]
    for folder in (out, out / "undistorted"):
        assert [path.name for path in (folder / "masks").iterdir()] == [f"{name}.png"]
        with Image.open(folder / "masks" / f"{name}.png") as mask:
            assert 0.8 < (np.asarray(mask) == 255).mean() < 0.97
    assert '"code": "without-mask"' in run.stderr
    assert "(1 masked)" in fvs("info", out).stdout
    others = shutil.copytree(photographs, tmp_path / "photographs")
    Image.new("L", (320, 240), 255).save(others / "masks" / f"{Path(name).stem}.png")
    again = fvs("reconstruct", others, "--out", out, *OPTIONS)
    assert again.status == EXIT_CODES["output-exists"]
    assert f"1 photograph is masked otherwise ({name})" in again.stderr


def test_others_can_open_the_undistorted_model(first_run: tuple[Path, Any]) -> None:
    out, run = first_run
    model = pycolmap.Reconstruction(str(out / "undistorted" / "sparse"))
    registered = run.document["manifest"]["cameras"]["registered"]
    assert sorted(image.name for image in model.images.values()) == registered
    for image in model.images.values():
        with Image.open(out / "undistorted" / "images" / image.name) as pixels:
            camera = model.cameras[image.camera_id]
            assert pixels.size == (camera.width, camera.height)
            assert camera.model.name == "PINHOLE"


def test_the_same_command_again_does_nothing(fvs: Fvs, photographs: Path, out: Path) -> None:
    before = (out / "splat" / "point_cloud.ply").stat().st_mtime_ns
    run = fvs("reconstruct", photographs, "--out", out, *OPTIONS)
    assert run.status == 0
    assert "Nothing to do" in run.stderr
    assert (out / "splat" / "point_cloud.ply").stat().st_mtime_ns == before


def test_more_iterations_go_on(fvs: Fvs, photographs: Path, out: Path) -> None:
    run = fvs("reconstruct", photographs, "--out", out, "--json", "--iterations", 140, *OPTIONS[2:])
    assert run.status == 0
    assert run.document["metrics"]["iterations"] == 140
    reports = [json.loads(line) for line in run.stderr.splitlines()]
    trained = [report["done"] for report in reports if report.get("stage") == "training"]
    assert min(trained) > 120
    assert not any(report.get("stage") == "features" for report in reports)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--iterations", 120, "--long-side", 240, "--test-every", 4), "test_every was 5 and is 4"),
        ((*OPTIONS, "--seed", 3), "seed was 0 and is 3"),
        ((*OPTIONS, "--no-gps"), "gps was True and is False"),
        ((*OPTIONS, "--quality", "fine"), "quality was coarse and is fine"),
        ((*OPTIONS, "--camera-model", "OPENCV"), "camera_model was the default and is OPENCV"),
    ],
)
def test_other_settings_are_not_mixed_in(
    fvs: Fvs, photographs: Path, first_run: tuple[Path, Any], options: tuple[Any, ...], message: str
) -> None:
    run = fvs("reconstruct", photographs, "--out", first_run[0], *options)
    assert run.status == EXIT_CODES["output-exists"]
    assert message in run.stderr
    assert "--overwrite" in run.stderr


def test_other_photographs_are_not_mixed_in(fvs: Fvs, kermit_dir: Path, first_run: tuple[Path, Any]) -> None:
    run = fvs("reconstruct", kermit_dir, "--out", first_run[0], *OPTIONS)
    assert run.status == EXIT_CODES["output-exists"]
    assert "photographs are new" in run.stderr
    assert "are gone" in run.stderr


def forget_training(out: Path) -> None:
    shutil.rmtree(out / "splat")
    (out / "metrics.json").unlink()
    manifest = json.loads((out / "manifest.json").read_text())
    manifest["training"] = None
    (out / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.slow  # half a minute; test_select.py has a shorter one
def test_ctrl_c_leaves_a_state_that_resumes_to_the_same_result(
    fvs_command: FvsCommand, fvs_until: FvsUntil, photographs: Path, out: Path
) -> None:
    # Gaussians are added up to iteration 1,000, by what was learned in the hundred iterations before.
    iterations, last_added_at = 2_000, 1_000
    arguments = ("reconstruct", photographs, "--out", out, "--iterations", iterations, *OPTIONS[2:])
    point_cloud = out / "splat" / "point_cloud.ply"
    forget_training(out)
    subprocess.run(fvs_command(*arguments), check=True, capture_output=True)
    uninterrupted = point_cloud.read_bytes()
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["training"]["gaussians"] > manifest["cameras"]["points"]

    forget_training(out)
    status, rest = fvs_until(
        *arguments,
        wanted=lambda report: report.get("stage") == "training" and report["done"] >= 20,
        number=signal.SIGINT,
    )
    assert status == EXIT_CODES["cancelled"]
    assert "Run the same command again to resume." in rest
    stopped = json.loads((out / "manifest.json").read_text())["training"]["iterations"]
    assert 20 <= stopped < last_added_at

    subprocess.run(fvs_command(*arguments), check=True, capture_output=True)
    assert point_cloud.read_bytes() == uninterrupted


def test_cameras_can_come_from_a_colmap_model(
    fvs: Fvs, photographs: Path, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    options = ("--colmap", first_run[0] / "sfm" / "sparse", "--iterations", 2, "--long-side", 240, "--json")
    run = fvs("reconstruct", photographs, "--out", tmp_path / "out", *options)
    assert run.status == 0, run.stderr
    before, after = (document["manifest"]["cameras"] for document in (first_run[1].document, run.document))
    assert after["source"] == "colmap"
    assert after["registered"] == before["registered"]
    assert after["points"] == before["points"]
    centres = [
        {image.name: image.projection_center() for image in _images(out)}
        for out in (first_run[0], tmp_path / "out")
    ]
    for name, centre in centres[0].items():
        np.testing.assert_allclose(centres[1][name], centre, atol=1e-9)


@pytest.mark.system
def test_known_intrinsics_are_kept_and_remembered(fvs: Fvs, kermit_copy: Path, tmp_path: Path) -> None:
    for path in sorted(kermit_copy.iterdir())[4:]:
        path.unlink()
    file = tmp_path / "cameras.txt"
    file.write_text("# of the photographs at twice their size\n1 PINHOLE 1280 960 1389 1389 640 480\n")
    arguments = ("reconstruct", kermit_copy, "--out", tmp_path / "out", "--iterations", 2, "--long-side", 240)
    run = fvs(*arguments, "--intrinsics", file, "--json")
    assert run.status == 0, run.stderr
    assert run.document["manifest"]["settings"]["intrinsics"]["model"] == "PINHOLE"
    model = pycolmap.Reconstruction(str(tmp_path / "out" / "sfm" / "sparse"))
    assert [camera.params.tolist() for camera in model.cameras.values()] == [[694.5, 694.5, 320.0, 240.0]]

    again = fvs(*arguments, "--intrinsics", file)
    assert again.status == 0
    assert "Nothing to do" in again.stderr
    file.write_text("1 PINHOLE 1280 960 1400 1400 640 480\n")
    other = fvs(*arguments, "--intrinsics", file)
    assert other.status == EXIT_CODES["output-exists"]
    assert "intrinsics was PINHOLE (1389, 1389, 640, 480)" in other.stderr


def test_a_colmap_model_of_other_photographs_is_refused(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    for index in range(3):
        pixels = np.random.default_rng(index).integers(0, 256, (60, 80, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"holiday {index}.png")
    colmap = first_run[0] / "sfm" / "sparse"
    run = fvs("reconstruct", tmp_path, "--out", tmp_path / "out", "--colmap", colmap)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "holiday 0.png" in run.stderr
    assert "these cameras were computed from" in run.stderr


def test_overwrite_starts_again(
    fvs: Fvs, kermit_dir: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to the first stage; that it clears the folder is what matters here."""
    (out / "mine.txt").write_text("stays")

    def cancelled(*_: object, **__: object) -> None:
        raise Cancelled("Stopped on request.")

    monkeypatch.setattr(stages, "run_native", cancelled)
    run = fvs("reconstruct", kermit_dir, "--out", out, "--overwrite")
    assert run.status == EXIT_CODES["cancelled"]
    assert (out / "mine.txt").read_text() == "stays"
    assert not (out / "splat").exists()
    assert not (out / "metrics.json").exists()
    run = fvs("info", out, "--json")
    assert run.document["stage"] == "structure from motion is not finished"
    (out / "sfm" / "rejected.json").write_text("[]")
    assert "rejected every model" in fvs("info", out, "--json").document["stage"]


@pytest.mark.system
def test_info_for_people(fvs: Fvs, first_run: tuple[Path, Any]) -> None:
    run = fvs("info", first_run[0])
    assert run.status == 0
    for fragment in ("11 used (1 masked), 3 left out", "registered", "120 of 120", "PSNR"):
        assert fragment in run.stdout


@pytest.mark.system
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_reader_that_left_ends_the_program_quietly(
    fvs_command: FvsCommand, first_run: tuple[Path, Any], options: tuple[str, ...]
) -> None:
    reading_end, writing_end = os.pipe()
    os.close(reading_end)
    try:
        command = fvs_command("info", first_run[0], *options)
        run = subprocess.run(command, stdout=writing_end, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(writing_end)
    assert run.returncode == -signal.SIGPIPE
    assert run.stderr == ""


def test_lines_are_whole_where_there_is_no_terminal(fvs: Fvs, first_run: tuple[Path, Any]) -> None:
    (training,) = [line for line in fvs("info", first_run[0]).stdout.splitlines() if "training" in line]
    assert "iterations/s" in training


def _images(out: Path) -> list[Any]:
    return list(pycolmap.Reconstruction(str(out / "undistorted" / "sparse")).images.values())
