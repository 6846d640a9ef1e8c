"""``fvs evaluate`` on a synthetic room with known poses; small enough to run every time."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from PIL import Image

from fvs_engine.choices import ProtocolName
from fvs_engine.cli.exit_codes import EXIT_CODES, INTERRUPTED, USAGE
from fvs_engine.lab.evaluate.protocol import PRESETS

pytestmark = pytest.mark.usefixtures("coarse_pictures")

Fvs = Callable[..., Any]
FvsUntil = Callable[..., tuple[int, str]]
OPTIONS = (
    *("--long-side", 64, "--initial-iterations", 4, "--iterations-per-view", 1, "--max-gaussians", 1_000),
    *("--methods", "farthest,median-frequency", "--seeds", "0,1", "--views", "4,5"),
)


def test_the_program_offers_the_presets() -> None:
    assert get_args(ProtocolName) == tuple(PRESETS)


@pytest.fixture(scope="module")
def clean_run(fvs: Fvs, room_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The output folder of one experiment, and how its run ended. Not to be changed."""
    out = tmp_path_factory.mktemp("results") / "out"
    return out, fvs("evaluate", room_dir, "--out", out, "--json", "--calibrate", *OPTIONS)


def test_the_table_and_its_plots_are_written(clean_run: tuple[Path, Any]) -> None:
    out, run = clean_run
    assert run.status == 0, run.stderr
    document = run.document
    rows = {(row["method"], row["visited"]) for row in document["rows"]}
    assert rows == {(method, n) for method in ("farthest", "median-frequency") for n in (4, 5)}
    assert all(row["psnr_db"]["count"] == 2 for row in document["rows"])
    assert all(row["psnr_db"]["half_width"] is not None for row in document["rows"])
    assert {row["visited"] for row in document["correlations"]} == {4, 5}
    assert json.loads((out / "report.json").read_text()).items() <= document.items()
    assert "| median-frequency |" in (out / "report.md").read_text()
    for name in ("psnr", "travel", "trajectories", "calibration"):
        assert (out / f"{name}.png").stat().st_size > 3_000
        with Image.open(out / f"{name}.png") as picture:
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 50, name


def test_people_see_the_last_count_and_nothing_is_run_again(
    fvs: Fvs, room_dir: Path, clean_run: tuple[Path, Any]
) -> None:
    out, _ = clean_run
    before = {path: path.stat().st_mtime_ns for path in out.glob("runs/**/*.json")}
    run = fvs("evaluate", room_dir, "--out", out, "--calibrate", *OPTIONS)
    assert run.status == 0, run.stderr
    assert "After 5 views, seeds 0, 1:" in run.stdout
    assert "farthest" in run.stdout
    assert str(out / "psnr.png") in run.stdout
    assert {path: path.stat().st_mtime_ns for path in out.glob("runs/**/*.json")} == before


@pytest.mark.system
def test_travel_is_a_budget(fvs: Fvs, room_dir: Path, tmp_path: Path) -> None:
    options = (*OPTIONS[:8], "--preset", "travel", "--methods", "farthest,kriging", "--seeds", 0)
    options = (*options, "--views", 7, "--max-travel", 3, "--vehicles", 2)
    run = fvs("evaluate", room_dir, "--out", tmp_path / "out", "--json", *options)
    assert run.status == 0, run.stderr
    document = run.document
    assert document["protocol"]["max_travel"] == 3
    assert {(row["method"], row["share"]) for row in document["travel_rows"]} == {
        (method, share) for method in ("farthest", "kriging") for share in (0.25, 0.5, 0.75, 1.0)
    }
    for made in document["runs"]:
        assert all(flown <= 3 for flown in made["evaluations"][-1]["flown"])
    again = fvs("evaluate", room_dir, "--out", tmp_path / "out", *options)
    assert again.status == 0, again.stderr
    assert "Within a travel of 3, seeds 0:" in again.stdout
    assert (tmp_path / "out" / "travel.png").exists()


@pytest.mark.slow  # 20 s; evaluate/test_experiment.py resumes in process
def test_a_stopped_table_goes_on(
    fvs: Fvs, fvs_until: FvsUntil, room_dir: Path, tmp_path: Path, clean_run: tuple[Path, Any]
) -> None:
    out = tmp_path / "out"
    status, _ = fvs_until(
        *("evaluate", room_dir, "--out", out, *OPTIONS),
        wanted=lambda report: report.get("stage") == "experiment" and report["done"] > 2,
        number=signal.SIGINT,
    )
    assert status == INTERRUPTED
    run = fvs("evaluate", room_dir, "--out", out, "--json", *OPTIONS)
    assert run.status == 0, run.stderr
    orders = [
        [made["order"] for made in document["runs"]] for document in (run.document, clean_run[1].document)
    ]
    assert orders[0] == orders[1]


@pytest.mark.parametrize(
    ("options", "code", "problem"),
    [
        (("--methods", "farthest,psychic"), "invalid-input", "psychic"),
        (("--views", "10,4"), "invalid-input", "rise"),
        (("--views", "4,400"), "invalid-input", "400 views are to be visited"),
        (("--radius", 1, "--nearest", 2), "invalid-input", "one of the three"),
        (("--max-travel", 0.0001), "invalid-input", "reaches no view"),
    ],
)
def test_what_cannot_be_run_is_refused(
    fvs: Fvs, room_dir: Path, tmp_path: Path, options: tuple[object, ...], code: str, problem: str
) -> None:
    run = fvs("evaluate", room_dir, "--out", tmp_path / "out", *options)
    assert run.status == EXIT_CODES[code]
    assert problem in run.stderr


@pytest.mark.parametrize("option", ["--seeds", "--views"])
def test_lists_are_of_whole_numbers(fvs: Fvs, room_dir: Path, tmp_path: Path, option: str) -> None:
    run = fvs("evaluate", room_dir, "--out", tmp_path / "out", option, "1,two")
    assert run.status == USAGE
    assert not (tmp_path / "out").exists()
