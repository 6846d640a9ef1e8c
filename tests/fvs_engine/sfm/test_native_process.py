import functools
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fvs_engine import child_process
from fvs_engine.child_process import EXIT_ORPHANED
from fvs_engine.errors import Cancelled, ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm import native_process
from fvs_engine.sfm.native_process import run_native

CHILD = [sys.executable, "-m", "fvs_engine.sfm.native.child"]


def run_child(parent: int, order: bytes) -> tuple[int, bytes]:
    child = subprocess.Popen([*CHILD, str(parent)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    answer, _ = child.communicate(order, timeout=30)
    return child.returncode, answer


def use_child(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    def spawn(_module: str, _order: str, **pipes: object) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=pipes["stderr"],  # type: ignore[arg-type]
            text=True,
        )

    monkeypatch.setattr(native_process, "spawn", spawn)
    monkeypatch.setattr(native_process, "_children", threading.local())


def failed_job(tmp_path: Path) -> "subprocess.Popen[str]":
    """Run a job that fails; returns this thread's child."""
    arguments = {
        "model_dir": str(tmp_path / "none"),
        "image_dir": "",
        "out_dir": str(tmp_path),
        "quality": 99,
    }
    with pytest.raises(ReconstructionError, match="'undistort' failed"):
        run_native("undistort", arguments, tmp_path / "native.log", Monitor())
    return native_process._children.child._process


def test_the_child_does_nothing_when_its_parent_is_gone():
    order = {"job": "match", "arguments": {}, "log": os.devnull, "folder": "."}
    not_its_parent = os.getppid()
    assert run_child(not_its_parent, json.dumps(order).encode() + b"\n") == (EXIT_ORPHANED, b"")
    assert run_child(os.getpid(), b"") == (0, b"")


def test_the_jobs_of_a_thread_run_in_forks_of_one_child_that_ends_with_it(tmp_path: Path):
    children = []
    thread = threading.Thread(target=lambda: children.extend(failed_job(tmp_path) for _ in range(2)))
    thread.start()
    thread.join()
    assert children[0] is children[1]
    assert children[0].returncode is not None


def test_a_child_that_was_killed_between_two_jobs_is_replaced(tmp_path: Path):
    child = failed_job(tmp_path)
    child.kill()
    child.wait()
    assert failed_job(tmp_path).pid != child.pid


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
    use_child(monkeypatch, "import os; os.kill(os.getpid(), 9)")
    with pytest.raises(ReconstructionError, match=r"died \(signal SIGKILL\)") as caught:
        run_native("match", {}, tmp_path / "native.log", Monitor())
    assert "memory" in caught.value.hint


def test_a_child_that_ignores_the_request_to_stop_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    use_child(
        monkeypatch, "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
    )
    monkeypatch.setattr(native_process, "stop", functools.partial(child_process.stop, patience_s=0.2))
    monitor = Monitor()
    timer = threading.Timer(1.0, monitor.cancel)
    timer.start()
    began = time.monotonic()
    with pytest.raises(Cancelled):
        run_native("match", {}, tmp_path / "native.log", monitor)
    timer.join()
    assert time.monotonic() - began < 10.0
