"""Run pycolmap in a child process that can be stopped and whose output goes to a log file.

pycolmap blocks in C++ for tens of seconds, and not all of it takes a cancellation token (global mapping and
view graph calibration do not); a process can always be stopped. What the C++ prints goes to a log file.

The jobs of one thread run one after another in forks of one child (``native.child``), which ends with the
thread.
"""

import contextlib
import json
import os
import queue
import signal
import subprocess
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from fvs_engine.child_process import close_pipes, spawn, stop, write
from fvs_engine.errors import NativeJobError, NoProcessError, ProcessDiedError
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.jobs import Answer, Request

_CHILD = "fvs_engine.sfm.native.child"
_ENVIRONMENT = {
    "GLOG_minloglevel": "0",
    "GLOG_logtostderr": "1",
    "OPENBLAS_NUM_THREADS": "1",  # a process with threads must not be forked
}
_KILLED = {-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT, -signal.SIGHUP}
"""Exit statuses of a process that was killed: by a user, or by the system when memory runs out."""
_LOG_BYTES = 8_000_000
"""Size of a log above which it is renamed to ``native.old.log``, replacing the one before."""
_LOGGED_CHARACTERS = 2_000
"""Maximum length of a request in the log: it contains the priors of all images."""
_POLL_S = 0.1
_TICK_S = 0.3

Progress = Callable[[], None]


def run_native(
    request: Request[Answer],
    log_file: Path,
    monitor: Monitor,
    *,
    on_tick: Progress | None = None,
    on_event: Callable[[int], None] | None = None,
) -> Answer:
    """Run the job of ``request`` in a child; returns its answer.

    ``on_tick`` is called a few times a second while the child works, ``on_event`` with each number that it
    reports. Raises ``Cancelled`` when the monitor is cancelled, after the child has ended;
    ``NativeJobError`` when the job fails, ``ProcessDiedError`` when its process dies, ``NoProcessError`` when
    it gets none.
    """
    monitor.check()
    log_file.parent.mkdir(parents=True, exist_ok=True)
    job, plain = request.job, request.model_dump(mode="json")
    order = {
        "job": job,
        "request": plain,
        "log": str(log_file.absolute()),
        "folder": str(Path.cwd()),
    }
    child = _this_threads_child()
    try:
        with _open_log(log_file) as log:
            log.write(f"== {job} {_shortened(json.dumps(plain))}\n")
            log.flush()
            child.begin(json.dumps(order), log)
        outcome, status = _wait(child, monitor, on_tick, on_event)
    except BaseException:
        child.end()
        raise
    if outcome is None:
        raise _death(job, status, log_file)
    if "error" in outcome:
        reason = outcome["error"].rstrip(".")
        raise NativeJobError(job, reason, hint=f"Details are in {log_file}.", path=log_file)
    return request.read(outcome["result"])


def _open_log(file: Path) -> IO[str]:
    with contextlib.suppress(FileNotFoundError):
        if file.stat().st_size > _LOG_BYTES:
            file.replace(file.with_name(f"{file.stem}.old{file.suffix}"))
    return file.open("a", encoding="utf-8")


def _shortened(text: str) -> str:
    if len(text) <= _LOGGED_CHARACTERS:
        return text
    return f"{text[:_LOGGED_CHARACTERS]}… ({len(text)} characters)"


def _death(job: str, status: int, log_file: Path) -> ProcessDiedError:
    """The error for a child that ended with ``status`` (minus the signal that ended it) and no result."""
    if status in _KILLED:
        hint = f"It was killed, or memory ran out: use fewer or smaller images. See {log_file}."
    else:
        hint = f"pycolmap crashed. Its last output is in {log_file}."
    how = f"exit status {status}" if status >= 0 else f"signal {signal.Signals(-status).name}"
    return ProcessDiedError(job, how, crashed=status not in _KILLED, hint=hint, path=log_file)


def _no_process(reason: str) -> NoProcessError:
    return NoProcessError(
        f"No process of structure from motion could be started: {reason}.",
        hint="Free some memory, or end other processes, and try again. Its output is in native.log.",
    )


def end_child() -> None:
    """End this thread's SfM child, which holds 90 MB of memory; the next native job starts a new one."""
    if hasattr(_children, "child"):
        _children.child.end()


class _Child:
    """The process in whose forks jobs run, one after another; it is made when the first one begins."""

    def __init__(self) -> None:
        self._answers: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._process: subprocess.Popen[str] | None = None
        self._end: Callable[[], object] = lambda: None

    def begin(self, order: str, log: IO[str]) -> None:
        """Begin a job; the output of a new process before its first job goes to ``log``."""
        if self._process is not None and self._process.poll() is None:
            write(self._process, order + "\n")
            return
        self.end()
        self._answers = queue.SimpleQueue()
        try:
            process = spawn(_CHILD, order, arguments=[str(os.getpid())], stderr=log, environment=_ENVIRONMENT)
        except OSError as error:
            raise _no_process(error.strerror or str(error)) from error
        reader = threading.Thread(target=_read, args=(process, self._answers), daemon=True)
        reader.start()
        self._process, self._end = process, weakref.finalize(self, _end, process, reader)

    def answer(self, timeout_s: float) -> dict[str, Any] | None:
        """The next answer; empty when there is none in time, None when the process has died."""
        try:
            line = self._answers.get(timeout=timeout_s)
            return None if line is None else json.loads(line)
        except (queue.Empty, ValueError):  # a job that died may have left a part of a line
            return {}

    def end(self) -> int:
        """End the process and its job; returns the exit status, or minus the signal that ended it."""
        self._end()
        return 0 if self._process is None else self._process.returncode


_children = threading.local()


def _this_threads_child() -> _Child:
    """The child of this thread, which ends with it: the kernel kills it when the thread has ended."""
    if not hasattr(_children, "child"):
        _children.child = _Child()
    child: _Child = _children.child
    return child


def _read(process: "subprocess.Popen[str]", answers: "queue.SimpleQueue[str | None]") -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("{"):
            answers.put(line)
    answers.put(None)


def _end(process: "subprocess.Popen[str]", reader: threading.Thread) -> None:
    stop(process)
    reader.join()  # the job has ended, too: it holds the other end of the pipe
    close_pipes(process)


def _wait(
    child: _Child,
    monitor: Monitor,
    on_tick: Progress | None,
    on_event: Callable[[int], None] | None,
) -> tuple[dict[str, Any] | None, int]:
    """The job's result or error, None when it has died, and its exit status."""
    outcome, last_tick = None, 0.0
    while True:
        answer = child.answer(_POLL_S)
        if answer is None:
            status = child.end()
            if outcome is None and status > 0:
                raise _no_process(f"the one that starts them ended with exit status {status}")
            return outcome, status
        if "no_process" in answer:
            raise _no_process(answer["no_process"])
        if "ended" in answer:
            return outcome, answer["ended"]
        if "event" in answer:
            if on_event is not None:
                on_event(int(answer["event"]))
        elif answer:
            outcome = answer
        monitor.check()
        if on_tick is not None and time.monotonic() - last_tick >= _TICK_S:
            on_tick()
            last_tick = time.monotonic()
