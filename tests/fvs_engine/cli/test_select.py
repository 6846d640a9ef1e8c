"""``fvs select`` on a synthetic room with known poses; small enough to run every time."""

import json
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from PIL import Image

from fvs_engine.cli.exit_codes import EXIT_CODES, INTERRUPTED, USAGE
from fvs_engine.lab.baselines import SELECTORS
from fvs_engine.splat.ply import read_ply
from fvs_schema.words import Method

pytestmark = pytest.mark.usefixtures("coarse_pictures")

Fvs = Callable[..., Any]
FvsCommand = Callable[..., list[str]]
FvsUntil = Callable[..., tuple[int, str]]
QUICK = ("--poses", "known", "--long-side", 64, "--initial-iterations", 4, "--iterations-per-view", 1)
OPTIONS = (*QUICK, "--initial", 4, "--budget", 8, "--nearest", 6)


def names_of(document: dict[str, Any]) -> list[str]:
    return [view["name"] for view in document["views"]]


@pytest.fixture(scope="module")
def clean_run(fvs: Fvs, room_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The output folder of one selection, and how its run ended. Not to be changed."""
    out = tmp_path_factory.mktemp("results") / "out"
    return out, fvs("select", room_dir, "--out", out, "--json", *OPTIONS)


def test_every_method_that_can_be_chosen_exists() -> None:
    assert get_args(Method) == tuple(SELECTORS)


def test_views_are_chosen_and_everything_is_written(clean_run: tuple[Path, Any]) -> None:
    out, run = clean_run
    assert run.status == 0, run.stderr
    document = run.document
    assert document["stop"]["kind"] == "budget"
    assert [view["order"] for view in document["views"]] == list(range(1, 9))
    assert [view["initial"] for view in document["views"]] == [True] * 4 + [False] * 4
    assert document["travel"] == pytest.approx(sum(view["distance"] for view in document["views"]))
    assert not set(document["test"]) & set(names_of(document))
    assert json.loads((out / "result.json").read_text()).items() <= document.items()
    with Image.open(out / "trajectory.png") as picture:
        assert min(picture.size) > 200
        assert len(picture.convert("RGB").getcolors(1 << 24)) > 50
    assert len(read_ply(out / "point_cloud.ply")) == document["gaussians"]


@pytest.mark.system
def test_people_see_a_table_and_why_it_ended(fvs: Fvs, room_dir: Path, clean_run: tuple[Path, Any]) -> None:
    """The same command on a finished folder only says so again."""
    out, first = clean_run
    before = (out / "scene" / "full.safetensors").read_bytes()
    run = fvs("select", room_dir, "--out", out, *OPTIONS)
    assert run.status == 0, run.stderr
    rows = [line.split() for line in run.stdout.splitlines()]
    assert [row[1] for row in rows[1:9]] == names_of(first.document)
    assert "The budget of 8 views is used." in run.stdout
    assert str(out / "trajectory.png") in run.stdout
    assert (out / "scene" / "full.safetensors").read_bytes() == before


@pytest.mark.system
def test_two_vehicles_fly_as_far_as_they_may(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    options = (*QUICK, "--initial", 4, "--budget", 14, "--nearest", 99, "--max-travel", 3, "--vehicles", 2)
    options = (*options, "--method", "farthest")
    run = fvs("select", room_dir, "--out", tmp_path / "out", "--json", *options)
    assert run.status == 0, run.stderr
    document = run.document
    assert document["stop"]["kind"] == "travel"
    assert document["max_travel"] == 3
    flown = [0.0, 0.0]
    for view in document["views"][4:]:
        flown[view["vehicle"] - 1] += view["distance"]
    assert document["flown"] == pytest.approx(flown)
    assert all(0 < length <= 3 for length in flown)
    assert {view["vehicle"] for view in document["views"][:4]} == {None}
    assert document["travel"] == pytest.approx(sum(view["distance"] for view in document["views"]))
    again = fvs("select", room_dir, "--out", tmp_path / "out", *options)
    assert again.status == 0, again.stderr
    assert "The travel is used" in again.stdout
    assert "Flown by each vehicle after the initial views: " in again.stdout
    assert sum("vehicle 2" in line for line in again.stdout.splitlines()) >= 1
    other = fvs("select", room_dir, "--out", tmp_path / "out", *options, "--max-travel", 6)
    assert other.status == EXIT_CODES["output-exists"]
    little = fvs("select", room_dir, "--out", tmp_path / "little", *OPTIONS, "--max-travel", 0.001)
    assert little.status == EXIT_CODES["invalid-input"]
    assert "reaches no view" in little.stderr


def test_without_a_budget_a_small_dataset_is_visited_whole(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    options = (*QUICK[:-1], 0, "--initial", 20, "--method", "random", "--nearest", 9)
    run = fvs("select", room_dir, "--out", tmp_path / "out", "--json", *options)
    assert run.status == 0, run.stderr
    assert len(run.document["views"]) == 21


def kill_at_random_moments(command: list[str], kills: int, seconds: float, seed: int) -> int:
    """Run the command, SIGKILL it after a random time, again; returns how many were really killed."""
    draw = random.Random(seed)
    killed = 0
    for _ in range(kills):
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        ) as process:
            try:
                process.wait(timeout=draw.uniform(0.0, seconds))
            except subprocess.TimeoutExpired:
                process.kill()
                killed += 1
    return killed


def assert_kills_change_nothing(
    command: Callable[[Path], list[str]], folder: Path, kills: int
) -> dict[str, Any]:
    """A killed and resumed selection is a clean one, to the last bit of every score.

    Estimated poses are doubles, whose last digits may differ: the solver's order of summation depends on
    addresses. Scores are of single precision.
    """
    began = time.monotonic()
    subprocess.run(command(folder / "clean"), check=True, capture_output=True)
    seconds = time.monotonic() - began
    # Work that was done is not done again: with moments spread like this, kills fall into every part.
    assert (
        kill_at_random_moments(command(folder / "killed"), kills, 1.2 * seconds / kills + 2, seed=kills) > 0
    )
    subprocess.run(command(folder / "killed"), check=True, capture_output=True)
    clean, killed = (json.loads((folder / name / "result.json").read_text()) for name in ("clean", "killed"))
    clean.pop("seconds")
    killed.pop("seconds")
    assert killed.pop("worst_rms") == pytest.approx(clean.pop("worst_rms"), rel=1e-9)
    expected = [result.pop("expected") for result in (clean, killed)]
    assert expected[1]["variance"] == pytest.approx(expected[0]["variance"], rel=1e-9)
    assert expected[1]["forecast"] == pytest.approx(expected[0]["forecast"], rel=1e-6)
    assert killed == clean
    for step in sorted((folder / "clean" / "steps").iterdir()):
        rankings = [
            json.loads((folder / name / "steps" / step.name).read_text())["choice"]["ranked"]
            for name in ("clean", "killed")
        ]
        assert rankings[0] == rankings[1]
    return clean


@pytest.mark.slow  # half a minute; select/test_loop.py resumes in process
def test_killing_it_changes_nothing(
    fvs_command: FvsCommand, room_dir: Path, clean_run: tuple[Path, Any], tmp_path: Path
) -> None:
    """The run before has compiled the kernels: processes that load them agree to the last bit."""

    def command(out: Path) -> list[str]:
        return fvs_command("select", room_dir, "--out", out, *OPTIONS)

    found = assert_kills_change_nothing(command, tmp_path, kills=3)
    assert names_of(found) == names_of(clean_run[1].document)


@pytest.mark.slow
@pytest.mark.timeout(1_200)
def test_ten_kills_change_nothing_with_known_poses(
    fvs_command: FvsCommand, room_dir: Path, clean_run: tuple[Path, Any], tmp_path: Path
) -> None:
    def command(out: Path) -> list[str]:
        options = ("--poses", "known", "--initial", 4, "--budget", 16, "--initial-iterations", 300)
        return fvs_command("select", room_dir, "--out", out, "--nearest", 6, *options)

    assert clean_run[1].status == 0
    assert_kills_change_nothing(command, tmp_path, kills=10)


@pytest.mark.slow
@pytest.mark.timeout(1_200)
def test_ten_kills_change_nothing_with_structure_from_motion(
    fvs: Fvs, fvs_command: FvsCommand, kermit_dir: Path, tmp_path: Path
) -> None:
    """Kermit, with the poses that structure from motion on all eleven photographs found."""
    whole = tmp_path / "whole"
    assert fvs("reconstruct", kermit_dir, "--out", whole, "--iterations", 1, "--long-side", 64).status == 0
    shutil.copytree(whole / "undistorted" / "images", tmp_path / "dataset" / "images")
    shutil.copytree(whole / "undistorted" / "sparse", tmp_path / "dataset" / "sparse")

    def command(out: Path) -> list[str]:
        options = ("--poses", "sfm", "--initial", 5, "--budget", 9, "--nearest", 3, "--test-every", 0)
        short = ("--long-side", 160, "--initial-iterations", 200, "--iterations-per-view", 50)
        return fvs_command("select", tmp_path / "dataset", "--out", out, *options, *short)

    found = assert_kills_change_nothing(command, tmp_path, kills=10)
    assert any(view["registered"] for view in found["views"][5:])  # the model grew


@pytest.mark.system
def test_ctrl_c_ends_it_with_a_resumable_state(fvs_until: FvsUntil, room_dir: Path, tmp_path: Path) -> None:
    options = (*QUICK[:4], "--initial-iterations", 5_000, "--initial", 4, "--budget", 5)
    status, said = fvs_until(
        *("select", room_dir, "--out", tmp_path, *options),
        wanted=lambda report: report.get("stage") == "quick-training",
        number=signal.SIGINT,
    )
    assert status == INTERRUPTED
    assert "Traceback" not in said
    assert "Run the same command again" in said
    assert (tmp_path / "scene" / "training.safetensors").exists()


def test_a_time_limit_is_said(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    run = fvs("select", room_dir, "--out", tmp_path / "out", *OPTIONS, "--time-limit", 0.001)
    assert run.status == 0
    assert "time limit of 0.001 s" in run.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--radius", 0.1), "; a radius of 0.3"),  # or 0.301, by the last bit of 0.3
        (("--radius", 3, "--nearest", 4), "give one of the two"),
        (("--radius", 0), "radius: it must be more than 0"),
        (("--budget", 100), "has only 21 to visit"),
        (("--initial", 22), "has only 21 views to visit, and the selection begins with 22"),
        (("--budget", 5), "must not be less than initial"),
        (("--test-every", 1), "Every view would be held out"),
        (("--colmap", "a", "--transforms", "b"), "Poses can come from one source only"),
        (("--colmap", "no/such/folder"), "The folder no/such/folder does not exist"),
    ],
)
def test_bad_settings_are_named_before_anything_is_written(
    fvs: Fvs, room_dir: Path, tmp_path: Path, options: tuple[object, ...], message: str
) -> None:
    run = fvs("select", room_dir, "--out", tmp_path / "out", *QUICK, *options)
    assert run.status == EXIT_CODES["invalid-input"]
    assert message in run.stderr
    assert "Traceback" not in run.stderr
    assert not (tmp_path / "out" / "selection.json").exists()


def test_an_unknown_method_is_wrong_usage(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    run = fvs("select", room_dir, "--out", tmp_path, "--method", "tea-leaves")
    assert run.status == USAGE
    assert "median-frequency" in run.stderr


def _transforms(room_dir: Path, folder: Path, count: int) -> tuple[Path, list[dict[str, Any]]]:
    """A dataset in ``folder`` of the room's first photographs; its frames are all at the origin."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for path in sorted((room_dir / "images").iterdir())[:count]:
        shutil.copyfile(path, folder / "images" / path.name)
        frames.append({"file_path": f"images/{path.name}", "transform_matrix": np.eye(4).tolist()})
    return folder / "transforms.json", frames


def _write(path: Path, frames: list[dict[str, Any]]) -> None:
    camera = {"fl_x": 77, "fl_y": 77, "cx": 48, "cy": 36, "w": 96, "h": 72}
    path.write_text(json.dumps({**camera, "frames": frames}))


def test_poses_that_are_no_numbers_are_named(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    path, frames = _transforms(room_dir, tmp_path / "data", 3)
    frames[1]["transform_matrix"][0][3] = float("nan")
    _write(path, frames)
    run = fvs("select", tmp_path / "data", "--out", tmp_path / "out", *QUICK)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "01.png" in run.stderr


def test_missing_photographs_are_said_and_the_rest_is_used(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    path, frames = _transforms(room_dir, tmp_path / "data", 3)
    frames.append({"file_path": "images/missing.png", "transform_matrix": np.eye(4).tolist()})
    _write(path, frames)
    options = (*QUICK, "--test-every", 0, "--initial", 2)
    run = fvs("select", tmp_path / "data", "--out", tmp_path / "out", *options)
    assert "images/missing.png" in run.stderr
    # All three have the same position, which no radius can order.
    assert run.status == EXIT_CODES["invalid-input"]
    assert "have the same position" in run.stderr


def test_a_folder_without_poses_says_where_they_are_sought(fvs: Fvs, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    run = fvs("select", tmp_path / "photos", "--out", tmp_path / "out")
    assert run.status == EXIT_CODES["invalid-input"]
    assert "neither transforms.json nor a COLMAP model" in run.stderr


def test_the_dataset_is_never_inside_the_output(fvs: Fvs, room_dir: Path) -> None:
    run = fvs("select", room_dir, "--out", room_dir.parent, *QUICK)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "lies inside the output folder" in run.stderr
