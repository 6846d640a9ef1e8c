"""``fvs simulate``, as a user types it."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fvs_engine.cli.app import app
from fvs_engine.cli.exit_codes import exit_code_of
from fvs_engine.errors import StorageError


def test_it_leaves_photographs_and_the_truth(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["simulate", str(tmp_path / "yard"), "--images", "2", "--size", "96x64"])
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "yard/images").iterdir()) == ["0000.jpg", "0001.jpg"]
    truth = json.loads((tmp_path / "yard/transforms.json").read_text())
    assert (truth["w"], truth["h"], len(truth["frames"])) == (96, 64, 2)


@pytest.mark.system
def test_a_survey_looks_down_from_thirty_metres(tmp_path: Path) -> None:
    options = ["simulate", str(tmp_path / "site"), "--survey", "--images", "2", "--size", "48x32"]
    result = CliRunner().invoke(app, options)
    assert result.exit_code == 0, result.output
    truth = json.loads((tmp_path / "site/transforms.json").read_text())
    heights = [frame["transform_matrix"][2][3] for frame in truth["frames"]]
    assert all(25 < height < 35 for height in heights)
    result = CliRunner().invoke(app, [*options, "--turns", "2"])
    assert result.exit_code == 2
    assert "no orbit" in result.output


def test_a_courtyard_that_looks_alike_is_another_one_seen_from_its_middle(tmp_path: Path) -> None:
    options = ["--images", "1", "--size", "96x64"]
    plain, four = tmp_path / "plain", tmp_path / "four"
    alike = ["--look-alike", "four", "--outwards"]
    for arguments in ([str(plain), *options], [str(four), *options, *alike]):
        result = CliRunner().invoke(app, ["simulate", *arguments])
        assert result.exit_code == 0, result.output
    photographs = [(folder / "images/0000.jpg").read_bytes() for folder in (plain, four)]
    assert photographs[0] != photographs[1]
    truth = json.loads((four / "transforms.json").read_text())
    axis, centre = np.array(truth["frames"][0]["transform_matrix"])[:3, 2:].T
    assert axis[:2] @ centre[:2] < 0  # OpenGL cameras look along -z
    for wrong in (["--survey"], ["--radius", "3"]):
        result = CliRunner().invoke(app, ["simulate", str(tmp_path / "no"), *alike, *wrong])
        assert result.exit_code == 2
        assert "leave" in result.output


@pytest.mark.parametrize("size", ["640", "0x480", "640x480x3", "99999x10", "-5x10"])
def test_a_wrong_size_is_a_usage_error(tmp_path: Path, size: str) -> None:
    result = CliRunner().invoke(app, ["simulate", str(tmp_path), f"--size={size}"])
    assert result.exit_code == 2
    assert "640x480" in result.output


@pytest.mark.parametrize("below", ["", "photographs"])
def test_a_vehicle_whose_folder_cannot_be_made_does_not_start(tmp_path: Path, below: str) -> None:
    (tmp_path / "taken").write_text("a file")
    result = CliRunner().invoke(app, ["simulate-vehicle", str(tmp_path / "taken" / below)])
    assert result.exit_code == exit_code_of(StorageError(""))
    assert "a file is in the way" in result.output


def test_a_vehicle_whose_truth_cannot_be_written_does_not_start(tmp_path: Path) -> None:
    truth = tmp_path / "missing" / "truth.jsonl"
    result = CliRunner().invoke(app, ["simulate-vehicle", str(tmp_path / "out"), "--truth", str(truth)])
    assert result.exit_code == exit_code_of(StorageError(""))
    assert f"{truth} cannot be written: No such file or directory." in result.output
