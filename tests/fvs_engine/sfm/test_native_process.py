import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fvs_engine.errors import Cancelled, ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm import native_process as native
from fvs_engine.sfm.native_process import run_native


def test_the_child_ends_when_its_parent_is_gone():
    child = subprocess.Popen(
        [sys.executable, "-m", "fvs_engine.sfm.native.child"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    answer, _ = child.communicate(b'{"job": "match", "arguments": {}}\n', timeout=30)  # and closes its input
    assert child.returncode == 1
    assert answer == b""


def test_a_job_that_fails_says_why_and_where_to_read_more(tmp_path: Path):
    log = tmp_path / "native.log"
    with pytest.raises(ReconstructionError, match=r"'undistort' failed") as caught:
        run_native(
            "undistort",
            {"model_dir": str(tmp_path / "none"), "image_dir": "", "out_dir": str(tmp_path), "quality": 99},
            log,
            Monitor(),
        )
    assert str(log) in caught.value.hint
    assert "Traceback" in log.read_text()


def test_a_child_that_dies_is_an_error_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(native, "_COMMAND", [sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"])
    with pytest.raises(ReconstructionError, match=r"died \(exit status -9\)") as caught:
        run_native("match", {}, tmp_path / "native.log", Monitor())
    assert "memory" in caught.value.hint


def test_a_child_that_ignores_the_request_to_stop_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
    monkeypatch.setattr(native, "_COMMAND", [sys.executable, "-c", stubborn])
    monkeypatch.setattr(native, "_PATIENCE_S", 0.2)
    monitor = Monitor()
    timer = threading.Timer(1.0, monitor.cancel)
    timer.start()
    began = time.monotonic()
    with pytest.raises(Cancelled):
        run_native("match", {}, tmp_path / "native.log", monitor)
    timer.join()
    assert time.monotonic() - began < 10.0
