import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from fvs_engine.errors import BackendUnavailableError, InvalidInputError
from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.evaluate.from_datasets import evaluate_selectors
from fvs_engine.lab.evaluate.protocol import PRESETS
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.select import select_views
from fvs_engine.pipeline.selection_request import SelectionRequest


def _select(dataset: Path, out: Path, monitor: Monitor) -> None:
    request = SelectionRequest(poses="known", initial=4)
    select_views(dataset, out, request, create_selector(request.method), monitor=monitor)


def _evaluate(dataset: Path, out: Path, monitor: Monitor) -> None:
    evaluate_selectors(dataset, out, PRESETS["fisherrf"], ["random"], [0], monitor=monitor)


@pytest.mark.parametrize("command", [_select, _evaluate])
def test_a_photograph_that_is_cut_off_is_named_before_anything_is_written(
    room_dir: Path, tmp_path: Path, command: Callable[[Path, Path, Monitor], None]
) -> None:
    dataset = tmp_path / "room"
    shutil.copytree(room_dir, dataset)
    cut = dataset / "images" / "17.png"
    with Image.open(cut) as whole:
        whole.save(cut, format="JPEG")  # what it is called does not count
    cut.write_bytes(cut.read_bytes()[:-500])
    with pytest.raises(InvalidInputError, match=r"17\.png cannot be used: it is damaged or cut off"):
        command(dataset, tmp_path / "out", Monitor())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("module", "command"), [("pipeline.select", _select), ("lab.evaluate.from_datasets", _evaluate)]
)
def test_whoever_waits_for_the_kernels_is_told_and_can_stop(
    room_dir: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    command: Callable[[Path, Path, Monitor], None],
) -> None:
    """The rasteriser may compile for minutes, the first time on a machine."""
    asked: list[Monitor | None] = []

    def create(_name: str, monitor: Monitor | None = None) -> None:
        asked.append(monitor)
        raise BackendUnavailableError("That is enough.")

    monkeypatch.setattr(f"fvs_engine.{module}.create_rasterizer", create)
    monitor = Monitor()
    with pytest.raises(BackendUnavailableError):
        command(room_dir, tmp_path / "out", monitor)
    assert asked == [monitor]
