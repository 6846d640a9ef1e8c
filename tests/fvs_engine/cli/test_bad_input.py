"""Every kind of bad input: one clear message that names the file and the remedy, and its own exit status."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fvs_engine.cli.exit_codes import EXIT_CODES

pytestmark = pytest.mark.usefixtures("all_native_here")

Fvs = Callable[..., Any]
SMALL = (160, 120)


def _noise(path: Path, seed: int, size: tuple[int, int] = (320, 240)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    small = np.random.default_rng(seed).integers(0, 256, (size[1] // 4, size[0] // 4, 3), dtype=np.uint8)
    Image.fromarray(small).resize(size, Image.Resampling.BICUBIC).save(path, quality=95)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "photographs").mkdir()
    return tmp_path / "photographs"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def _expect(run: Any, code: str, *fragments: str) -> None:
    assert run.status == EXIT_CODES[code], run.stderr
    for fragment in fragments:
        assert fragment in run.stderr
    assert run.stderr.count("Error: ") == 1


def test_a_folder_that_is_not_there(fvs: Fvs, folder: Path, out: Path) -> None:
    _expect(fvs("reconstruct", folder / "nope", "--out", out), "invalid-input", "nope", "does not exist")
    assert not out.exists()


def test_a_folder_whose_name_is_no_text(fvs: Fvs, tmp_path: Path, out: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    for arguments in ((folder, "--out", out), (tmp_path, "--out", folder)):
        run = fvs("reconstruct", *arguments, "--json")
        assert run.status == 2
        assert f"{tmp_path}/caf%E9 has bytes (%…) that are not UTF-8" in run.stderr
    assert not out.exists()


def test_an_empty_folder(fvs: Fvs, folder: Path, out: Path) -> None:
    _expect(
        fvs("reconstruct", folder, "--out", out),
        "no-images",
        str(folder),
        "no usable photograph",
        "at least two",
    )
    assert not out.exists()


def test_one_image(fvs: Fvs, folder: Path, out: Path) -> None:
    _noise(folder / "alone.jpg", 0)
    _expect(fvs("reconstruct", folder, "--out", out), "no-images", "alone.jpg", "overlap")


def test_only_files_that_cannot_be_used(fvs: Fvs, folder: Path, out: Path) -> None:
    (folder / "letter.jpg").write_text("Dear reader")
    run = fvs("reconstruct", folder, "--out", out)
    _expect(run, "no-images", "Left out letter.jpg", "not an image but text", "Convert it to JPEG or PNG")


def test_two_that_do_not_overlap(fvs: Fvs, folder: Path, out: Path) -> None:
    _noise(folder / "here.jpg", 1, SMALL)
    _noise(folder / "there.jpg", 2, SMALL)
    run = fvs("reconstruct", folder, "--out", out)
    _expect(run, "reconstruction-failed", "overlap")


def test_after_a_refusal_the_remedies_need_no_other_folder(fvs: Fvs, folder: Path, out: Path) -> None:
    _noise(folder / "here.jpg", 1, SMALL)
    _noise(folder / "there.jpg", 2, SMALL)
    _expect(fvs("reconstruct", folder, "--out", out), "reconstruction-failed", "overlap")
    _noise(folder / "in between.jpg", 3, SMALL)
    run = fvs("reconstruct", folder, "--out", out, "--camera-model", "opencv", "--long-side", 300)
    _expect(run, "reconstruction-failed", "No two of the 3 images")
    (folder / "here.jpg").unlink()
    run = fvs("reconstruct", folder, "--out", out)
    _expect(run, "output-exists", "1 photograph is gone (here.jpg)", "--overwrite")


def test_a_wall_without_texture(fvs: Fvs, folder: Path, out: Path) -> None:
    for index in range(4):
        # A wall is not a constant: light falls off across it, and the camera adds no detail.
        ramp = np.linspace(180 + index, 200 + index, 320, dtype=np.float64)
        pixels = np.broadcast_to(ramp[None, :, None], (240, 320, 3)).round().astype(np.uint8)
        Image.fromarray(np.ascontiguousarray(pixels)).save(folder / f"wall{index}.jpg", quality=95)
    run = fvs("reconstruct", folder, "--out", out)
    _expect(run, "reconstruction-failed", "texture")


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_output_where_a_file_is(fvs: Fvs, kermit_dir: Path, tmp_path: Path, below: str) -> None:
    (tmp_path / "taken").write_text("a file")
    run = fvs("reconstruct", kermit_dir, "--out", tmp_path / "taken" / below)
    _expect(run, "storage", "taken", "a file is in the way", "another output folder")
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.skipif(
    not Path("/proc/self").exists(),
    reason="needs a file system that nobody can write to: run it on Linux, for /proc",
)
def test_output_that_cannot_be_written(fvs: Fvs, kermit_dir: Path) -> None:
    _expect(fvs("reconstruct", kermit_dir, "--out", "/proc/fvs"), "storage", "/proc/fvs")


def test_an_existing_folder_of_somebody_else(fvs: Fvs, kermit_dir: Path, out: Path) -> None:
    out.mkdir()
    (out / "holiday.txt").write_text("precious")
    for options in ((), ("--overwrite",)):
        run = fvs("reconstruct", kermit_dir, "--out", out, *options)
        _expect(run, "output-exists", "holiday.txt", "another output folder")
    assert [path.name for path in out.iterdir()] == ["holiday.txt"]


def test_photographs_inside_the_output_folder(fvs: Fvs, out: Path) -> None:
    _noise(out / "images" / "precious.jpg", 0)
    run = fvs("reconstruct", out / "images", "--out", out, "--overwrite")
    _expect(run, "invalid-input", "inside the output folder", "outside")
    assert (out / "images" / "precious.jpg").exists()


@pytest.mark.parametrize("option", ["--colmap", "--transforms"])
def test_cameras_inside_the_output_folder(fvs: Fvs, kermit_dir: Path, out: Path, option: str) -> None:
    cameras = out / "sfm" / "sparse"
    cameras.mkdir(parents=True)
    (out / "manifest.json").write_text("{}")
    run = fvs("reconstruct", kermit_dir, "--out", out, option, cameras, "--overwrite")
    _expect(run, "invalid-input", "inside the output folder", "outside")
    assert cameras.exists()


@pytest.mark.system
def test_a_disk_that_fills_up(fvs_command: Callable[..., list[str]], folder: Path, out: Path) -> None:
    for seed in range(3):
        _noise(folder / f"{seed}.tif", seed)
    limit = "import os, resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000)); "
    prefix = [sys.executable, "-c", limit + "os.execv(sys.argv[1], sys.argv[1:])"]
    command = prefix + fvs_command("reconstruct", folder, "--out", out)
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == EXIT_CODES["disk-full"], run.stderr
    assert "no room left" in run.stderr
    assert "same command again" in run.stderr
    assert "Traceback" not in run.stderr


def test_cameras_from_two_places(fvs: Fvs, kermit_dir: Path, out: Path, tmp_path: Path) -> None:
    run = fvs(
        "reconstruct", kermit_dir, "--out", out, "--colmap", tmp_path, "--transforms", tmp_path / "t.json"
    )
    _expect(run, "invalid-input", "either --colmap or --transforms")


@pytest.mark.parametrize(
    ("options", "remedy"),
    [
        (("--camera-model", "OPENCV"), "either --intrinsics or --camera-model"),
        (("--colmap", "model"), "Leave out --intrinsics"),
        (("--transforms", "transforms.json"), "Leave out --intrinsics"),
    ],
)
def test_intrinsics_from_two_places(
    fvs: Fvs, kermit_dir: Path, out: Path, tmp_path: Path, options: tuple[str, ...], remedy: str
) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 480 694 694 320 240\n")
    run = fvs("reconstruct", kermit_dir, "--out", out, "--intrinsics", tmp_path / "cameras.txt", *options)
    _expect(run, "invalid-input", remedy)
    assert not out.exists()


def test_intrinsics_that_are_none(fvs: Fvs, kermit_dir: Path, out: Path, tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("focal length: 50 mm\n")
    run = fvs("reconstruct", kermit_dir, "--out", out, "--intrinsics", tmp_path / "cameras.txt")
    _expect(run, "invalid-input", "cameras.txt", "1 PINHOLE 1920 1080")
    assert not out.exists()


def test_intrinsics_of_another_shape(fvs: Fvs, folder: Path, out: Path, tmp_path: Path) -> None:
    for seed in range(2):
        _noise(folder / f"{seed}.jpg", seed)
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 640 640 694 694 320 320\n")
    run = fvs("reconstruct", folder, "--out", out, "--intrinsics", tmp_path / "cameras.txt")
    _expect(run, "invalid-input", "640×640", "320×240", "images of another shape")


def test_nothing_left_to_train_on(fvs: Fvs, kermit_dir: Path, out: Path) -> None:
    _expect(
        fvs("reconstruct", kermit_dir, "--out", out, "--test-every", 1), "invalid-input", "--test-every 1"
    )
    assert not out.exists()


@pytest.mark.parametrize("command", ["rank", "render", "plan", "info"])
def test_commands_that_need_a_result(fvs: Fvs, tmp_path: Path, command: str) -> None:
    remedy = "fvs reconstruct IMAGES --out DIR"
    _expect(fvs(command, tmp_path), "invalid-input", f"{tmp_path} is not the output", remedy)
    missing = tmp_path / "missing"
    _expect(fvs(command, missing), "invalid-input", f"The folder {missing} does not exist", remedy)


def test_errors_for_machines(fvs: Fvs, folder: Path, out: Path) -> None:
    run = fvs("reconstruct", folder, "--out", out, "--json")
    assert run.status == EXIT_CODES["no-images"]
    assert run.stdout == ""
    error = json.loads(run.stderr.splitlines()[-1])["error"]
    assert error["code"] == "no-images"
    assert error["hint"]


@pytest.mark.parametrize(
    "arguments",
    [("reconstruct",), ("reconstruct", ".", "--out", "x", "--quality", "superb"), ("rank",), ("fly",)],
)
def test_wrong_usage(fvs: Fvs, arguments: tuple[str, ...]) -> None:
    assert fvs(*arguments).status == 2


@pytest.mark.process
def test_help_is_quick_because_it_imports_no_engine() -> None:
    code = (
        "import sys; from fvs_engine.cli.app import app\n"
        "heavy = {'torch', 'numba', 'pycolmap', 'scipy', 'numpy'} & set(sys.modules); assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_masks_that_cannot_be_used_leave_their_photographs_out(fvs: Fvs, folder: Path, out: Path) -> None:
    (folder / "masks").mkdir()
    for seed, name in enumerate(("small", "black", "lost")):
        _noise(folder / f"{name}.jpg", seed)
    Image.new("L", (100, 100), 255).save(folder / "masks" / "small.png")
    Image.new("L", (320, 240)).save(folder / "masks" / "black.png")
    Image.new("L", (320, 240)).save(folder / "masks" / "lots.png")
    run = fvs("reconstruct", folder, "--out", out)
    _expect(run, "no-images", "only one usable photograph, lost.jpg")
    for fragment in (
        "small.jpg: its mask masks/small.png has 100×100 px, the photograph 320×240 px",
        "black.jpg: its mask leaves out every pixel",
        "masks/lots.png: it is in a folder of masks, and the mask of no photograph",
    ):
        assert fragment in " ".join(run.stderr.split())
