import contextlib
import errno
import functools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pycolmap
import pytest

from fvs_engine import child_process
from fvs_engine.child_process import EXIT_ORPHANED
from fvs_engine.errors import Cancelled, NoProcessError, ProcessDiedError, ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm import native_process
from fvs_engine.sfm.culprit import run_or_accuse
from fvs_engine.sfm.jobs import CalibrateViewGraph, CopyFeatures, MatchPairs, UndistortImages, VetoPairs
from fvs_engine.sfm.native_process import run_native
from fvs_engine.sfm.pose_priors import PosePriors

CHILD = [sys.executable, "-m", "fvs_engine.sfm.native.child"]
SOON_S = 60.0
ANY = CopyFeatures(source=Path("source.db"), target=Path("target.db"), names=())
"""The request of a job that gets no process, or one that does something else."""


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
    request = UndistortImages(
        model_dir=tmp_path / "none", image_dir=tmp_path, out_dir=tmp_path, names=(), jpeg_quality=99
    )
    with pytest.raises(ReconstructionError, match="'undistort' failed"):
        run_native(request, tmp_path / "native.log", Monitor())
    return native_process._children.child._process


@dataclass
class WaitingJob:
    """A job in a fork of ``child``, the second one there; it waits until its end for input from ``pipe``."""

    child: "subprocess.Popen[str]"
    outcome: "Future[None]"
    pipe: int

    def require_end(self) -> None:
        """Fail unless its process ends: nobody else reads from the pipe."""
        until = time.monotonic() + SOON_S
        with contextlib.suppress(BrokenPipeError):
            while time.monotonic() < until:
                os.write(self.pipe, b"\n")
                time.sleep(0.01)
            raise AssertionError

    def kill(self) -> None:
        """Kill its process alone."""
        (pid,) = Path(f"/proc/{self.child.pid}/task/{self.child.pid}/children").read_text().split()
        os.kill(int(pid), signal.SIGKILL)


@contextlib.contextmanager
def waiting_job(folder: Path, monitor: Monitor) -> Iterator[WaitingJob]:
    pairs, until = folder / "pairs", time.monotonic() + SOON_S
    os.mkfifo(pairs)
    pycolmap.Database.open(folder / "db").close()
    request = MatchPairs(
        database=folder / "db", parts_dir=folder / "parts", pair_list=pairs, batch=1, seed=0, threads=1
    )
    with ThreadPoolExecutor(1) as thread:
        child = thread.submit(failed_job, folder).result()
        outcome = thread.submit(run_native, request, folder / "native.log", monitor)
        while True:
            assert time.monotonic() < until
            with contextlib.suppress(OSError):  # nobody reads yet
                pipe = os.open(pairs, os.O_WRONLY | os.O_NONBLOCK)
                break
            time.sleep(0.01)
        try:
            yield WaitingJob(child, outcome, pipe)
        finally:
            os.close(pipe)


def test_the_child_does_nothing_when_its_parent_is_gone():
    order = {"job": "match", "request": {}, "log": os.devnull, "folder": "."}
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


@pytest.mark.system
def test_a_child_that_was_killed_between_two_jobs_is_replaced(tmp_path: Path):
    child = failed_job(tmp_path)
    child.kill()
    child.wait()
    assert failed_job(tmp_path).pid != child.pid


def test_a_child_that_is_not_needed_any_longer_leaves_nothing_in_the_log(tmp_path: Path):
    thread = threading.Thread(target=failed_job, args=(tmp_path,))
    thread.start()
    thread.join()
    assert "SIGTERM" not in (tmp_path / "native.log").read_text()


def test_a_child_has_one_thread_so_that_it_can_be_forked(tmp_path: Path):
    request = VetoPairs(database=tmp_path / "db", model_dir=tmp_path / "none", names=(), priors=PosePriors())
    with pytest.raises(ReconstructionError, match="'veto' failed"):
        run_native(request, tmp_path / "native.log", Monitor())  # has all imports
    pid = native_process._children.child._process.pid
    assert len(list(Path(f"/proc/{pid}/task").iterdir())) == 1


def test_a_job_that_is_cancelled_has_ended(tmp_path: Path):
    monitor = Monitor()
    with waiting_job(tmp_path, monitor) as job:
        monitor.cancel()
        assert isinstance(job.outcome.exception(SOON_S), Cancelled)
        job.require_end()


def test_a_job_ends_with_its_child(tmp_path: Path):
    with waiting_job(tmp_path, Monitor()) as job:
        job.child.kill()
        with pytest.raises(ProcessDiedError, match="SIGKILL") as caught:
            job.outcome.result(SOON_S)
        assert not caught.value.crashed
        job.require_end()


def test_a_job_that_is_killed_leaves_its_child_to_the_next_one(tmp_path: Path):
    with waiting_job(tmp_path, Monitor()) as job:
        job.kill()
        with pytest.raises(ProcessDiedError, match="SIGKILL") as caught:
            job.outcome.result(SOON_S)
        assert not caught.value.crashed
        assert job.child.poll() is None


NO_FORK = """
import errno, os
from fvs_engine.sfm.native import child

def fork():
    raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

os.fork = fork
child.kill_with_parent = lambda _: None
import sys
sys.argv = ["child", "0"]
child.main()
"""


def test_a_job_without_a_process_has_not_died(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    use_child(monkeypatch, NO_FORK)
    order = {"job": "match", "request": {}, "log": str(tmp_path / "log"), "folder": str(tmp_path)}
    spawn = native_process.spawn

    def ordered(module: str, _order: str, **pipes: object) -> "subprocess.Popen[str]":
        child = spawn(module, _order, **pipes)
        child_process.write(child, json.dumps(order) + "\n")
        return child

    monkeypatch.setattr(native_process, "spawn", ordered)
    with pytest.raises(NoProcessError, match="Cannot allocate memory") as caught:
        run_or_accuse(lambda _items: run_native(ANY, tmp_path / "log", Monitor()), ["a", "b"])
    assert "memory" in caught.value.hint
    native_process.end_child()


def test_no_child_is_no_death(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def spawn(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(native_process, "spawn", spawn)
    monkeypatch.setattr(native_process, "_children", threading.local())
    with pytest.raises(NoProcessError, match="temporarily unavailable"):
        run_native(ANY, tmp_path / "log", Monitor())


def test_a_child_can_be_ended_and_the_next_job_gets_another_one(tmp_path: Path):
    child = failed_job(tmp_path)
    native_process.end_child()
    assert child.returncode is not None
    assert failed_job(tmp_path).pid != child.pid


def test_a_part_of_a_line_is_no_answer():
    child = native_process._Child()
    for line in ('{"event": 1}\n', '{"resu\n', '{"ended": -9}\n'):
        child._answers.put(line)
    assert [child.answer(0.0) for _ in range(4)] == [{"event": 1}, {}, {"ended": -9}, {}]


def test_a_job_that_fails_says_why_and_where_to_read_more(tmp_path: Path):
    log, missing = tmp_path / "native.log", tmp_path / "none"
    request = CalibrateViewGraph(database=missing, target=tmp_path / "target", names=(), seed=0)
    with pytest.raises(ReconstructionError, match=f"'calibrate' failed: .*{missing}") as caught:
        run_native(request, log, Monitor())
    assert str(log) in caught.value.hint
    assert "Traceback" in log.read_text()


def test_a_child_that_dies_is_an_error_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    use_child(monkeypatch, "import os; os.kill(os.getpid(), 9)")
    with pytest.raises(ReconstructionError, match=r"died \(signal SIGKILL\)") as caught:
        run_native(ANY, tmp_path / "native.log", Monitor())
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
        run_native(ANY, tmp_path / "native.log", monitor)
    timer.join()
    assert time.monotonic() - began < 10.0


def test_the_log_of_a_scene_that_grows_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_process, "_LOG_BYTES", 10_000, raising=False)
    answer = """print('{"result": null}\\n{"ended": 0}', flush=True)"""
    use_child(
        monkeypatch, f"import sys\n{answer}\nfor _ in sys.stdin: {answer}"
    )  # the first order comes with it
    log = tmp_path / "native.log"
    for number in range(30):
        names = (str(number), "x" * 100_000)
        run_native(CopyFeatures(source=tmp_path, target=tmp_path, names=names), log, Monitor())
    assert '"names": ["29", "xxx' in log.read_text(encoding="utf-8")
    assert {file.name for file in tmp_path.iterdir()} == {"native.log", "native.old.log"}
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 30_000
