import io
import json

from rich.console import Console

from fvs_engine.cli.progress import BarDisplay, JsonDisplay, LogDisplay
from fvs_engine.monitor import Progress
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage


def test_machines_get_json_lines() -> None:
    stream = io.StringIO()
    with JsonDisplay(stream) as display:
        display.update(Progress(Stage.TRAINING, 1, 3, {"loss": 0.5}))
        display.update(Progress(Stage.TRAINING, 2, 3, {"loss": 0.4}))
        display.update(Progress(Stage.TRAINING, 3, 3, {"loss": 0.3}))
        display.warn(Finding.of(FindingCode.FEW_FEATURES, ["a.jpg"]))
        display.show("done")
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    # The second report follows the first within the interval and is left out; the last one never is.
    assert lines == [
        {"stage": "training", "done": 1, "total": 3, "loss": 0.5},
        {"stage": "training", "done": 3, "total": 3, "loss": 0.3},
        {
            "warning": {
                "code": "few-features",
                "severity": "warning",
                "images": ["a.jpg"],
                "candidates": [],
                "numbers": {},
                "texts": {},
                "message": "Almost no texture in a.jpg.",
                "hint": "Photograph something with structure, in focus and in light.",
            }
        },
        {"message": "done"},
    ]


def test_logs_get_the_first_and_the_last_report_of_a_stage() -> None:
    stream = io.StringIO()
    with LogDisplay(stream) as display:
        for done in range(1, 1001):
            display.update(Progress(Stage.IMAGES, done, 1000))
        display.update(Progress(Stage.IMAGES, 1000, 1000))
        display.update(Progress(Stage.GLOBAL_MAPPING, 5, None, {"points": 1234}))
    lines = stream.getvalue().splitlines()
    assert lines[0] == "Checking photographs: 1/1,000"
    assert lines[1].startswith("Checking photographs: 1,000/1,000, ")
    assert lines[2] == "Global mapping: 5, points 1,234"
    assert len(lines) == 3


def test_people_get_a_bar_per_stage() -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=160)
    with BarDisplay(console) as display:
        for done in range(3):
            display.update(Progress(Stage.IMAGES, done + 1, 3))
        display.update(Progress(Stage.TRAINING, 500, 1000, {"loss": 0.123456}))
        display.show("[a.jpg] was left out")
    shown = stream.getvalue()
    for text in (
        "Checking photographs",
        "3/3",
        "Training",
        "500/1,000",
        "loss 0.1235",
        "[a.jpg] was left out",
    ):
        assert text in shown


def test_numbers_are_whole_in_a_terminal_of_eighty_columns() -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=80, color_system=None)
    with BarDisplay(console) as display:
        display.update(Progress(Stage.CONTACT_SHEET, 1, 12))
        for done in (0, 12_345):
            display.update(Progress(Stage.TRAINING, done, 30_000, {"loss": 0.123456, "gaussians": 123_456}))
    last = [line for line in stream.getvalue().splitlines() if "Training" in line][-1]
    assert "12,345/30,000" in last
    assert "0:00:0" in last
    assert "…" not in stream.getvalue()
