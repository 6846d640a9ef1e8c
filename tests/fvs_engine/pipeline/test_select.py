import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import BackendUnavailableError, Cancelled, InvalidInputError
from fvs_engine.images.masks import read_mask
from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.evaluate.from_datasets import evaluate_selectors
from fvs_engine.lab.evaluate.protocol import PRESETS
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.select import select_views
from fvs_engine.pipeline.selection_request import SelectionRequest
from fvs_engine.scene.dataset import Dataset


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


@pytest.mark.parametrize(
    ("where", "command"),
    [
        ("pipeline.select.SelectionLoop.open", _select),
        ("lab.evaluate.from_datasets.run_experiment", _evaluate),
    ],
)
def test_the_masks_of_a_transforms_json_count(
    room_dir: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    where: str,
    command: Callable[[Path, Path, Monitor], None],
) -> None:
    opened: list[Dataset] = []

    def stop(_out: Path, dataset: Dataset, *_: object, **__: object) -> None:
        opened.append(dataset)
        raise Cancelled("That is enough.")

    monkeypatch.setattr(f"fvs_engine.{where}", stop)
    dataset = tmp_path / "room"
    shutil.copytree(room_dir, dataset)
    frames = [
        {"file_path": f"images/{file.name}", "transform_matrix": np.eye(4).tolist()}
        for file in sorted((dataset / "images").iterdir())
    ]
    frames[0]["mask_path"] = "half.png"
    name = Path(str(frames[0]["file_path"])).name
    with Image.open(dataset / "images" / name) as image:
        mask = np.tile(np.arange(image.width) > 20, (image.height, 1))
    Image.fromarray(mask).save(dataset / "half.png")
    head = {"w": mask.shape[1], "h": mask.shape[0], "fl_x": 50.0}
    (dataset / "transforms.json").write_text(json.dumps({**head, "frames": frames}))
    with pytest.raises(Cancelled):
        command(dataset, tmp_path / "out", Monitor())
    (found,) = opened
    np.testing.assert_array_equal(read_mask(found.image_dir, name), mask)

    Image.fromarray(mask[:5]).save(dataset / "half.png")
    with pytest.raises(InvalidInputError, match=rf"{name} cannot be used: its mask .*half\.png has"):
        command(dataset, tmp_path / "out", Monitor())
