"""``fvs frames``, as a user types it."""

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner
from videos import textured, write_video

from fvs_engine.cli.app import app


def test_it_prints_the_frames_and_what_they_lack(tmp_path: Path) -> None:
    video = write_video(tmp_path / "flight.mp4", [(number / 5, textured()) for number in range(5)])
    result = CliRunner().invoke(app, ["frames", str(video), "--out", str(tmp_path / "out"), "--every=0.4"])
    assert result.exit_code == 0, result.output
    printed = result.stdout.split()
    assert printed == [str(path) for path in sorted((tmp_path / "out").glob("flight_00h00m00.*s.jpg"))]
    assert len(printed) == 3
    assert "VIDEO.SRT" in result.stderr


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for module in [name for name in sys.modules if name.startswith("fvs_engine.video")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "av", None)
    result = CliRunner().invoke(app, ["--json", "frames", str(tmp_path / "a.mp4"), "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert "extra `video`" in json.loads(result.stderr)["error"]["message"]
