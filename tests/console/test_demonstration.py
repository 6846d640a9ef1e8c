"""``make demo KEEP=1`` leaves its page open until it is told to stop."""

import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[2] / "demo" / "run.py"


def test_its_page_stays_open_until_ctrl_c(photographs: list[Path], tmp_path: Path) -> None:
    for file in photographs[:5]:
        shutil.copy(file, tmp_path)
    command = [sys.executable, str(PROGRAM), str(tmp_path), "--keep", "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        [*command, "--iterations", "60", "--long-side", "96", "--generator", "orbit"],
        stdout=subprocess.PIPE,
        text=True,
    ) as demonstration:
        assert demonstration.stdout is not None
        said = ""
        while "stays open" not in said:
            said = demonstration.stdout.readline()
            assert said, "it ended"
        url = re.search(r"http://[^/]+/", said)
        assert url is not None
        page = urllib.request.Request(url[0], headers={"Accept": "text/html"})
        with urllib.request.urlopen(page) as answer:
            assert "<script" in answer.read().decode()
        demonstration.send_signal(signal.SIGINT)
        assert demonstration.wait(60) == 0
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(page)
