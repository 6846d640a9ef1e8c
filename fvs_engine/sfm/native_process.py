"""Run pycolmap in a child process that can be stopped and whose output goes to a log file.

pycolmap blocks in C++ for tens of seconds, and not all of it takes a cancellation token (global mapping and
view graph calibration do not); a process can always be stopped. What the C++ prints goes to a log file.
"""

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from fvs_engine.child_process import close_pipes, spawn, stop
from fvs_engine.errors import NativeJobError, ProcessDiedError
from fvs_engine.monitor import Monitor

_CHILD = "fvs_engine.sfm.native.child"
_LOGGING = {"GLOG_minloglevel": "0", "GLOG_logtostderr": "1"}
_KILLED = {-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT, -signal.SIGHUP}
"""How a process ends that somebody else ends: a user, the system when memory runs out."""
_POLL_S = 0.1
_TICK_S = 0.3

Progress = Callable[[], None]


def run_native(
    job: str,
    arguments: Mapping[str, Any],
    log_file: Path,
    monitor: Monitor,
    *,
    on_tick: Progress | None = None,
    on_event: Callable[[int], None] | None = None,
) -> Any:
    """Run ``job`` (see ``native.jobs.find_job``) with JSON ``arguments`` in a child; returns its JSON result.

    ``on_tick`` is called a few times a second while the child works, ``on_event`` with each number that it
    reports. Raises ``Cancelled`` when the monitor is cancelled, after the child has ended;
    ``NativeJobError`` when the job fails, ``ProcessDiedError`` when its process dies.
    """
    monitor.check()
    log_file.parent.mkdir(parents=True, exist_ok=True)
    order = json.dumps({"job": job, "arguments": dict(arguments), "parent": os.getpid()})
    with log_file.open("a", encoding="utf-8") as log:
        log.write(f"== {job} {json.dumps(dict(arguments))}\n")
        log.flush()
        child = spawn(_CHILD, order, stderr=log, environment=_LOGGING)
        messages: list[dict[str, Any]] = []
        reader = threading.Thread(target=_read, args=(child, messages), daemon=True)
        reader.start()
        try:
            _wait(child, messages, monitor, on_tick, on_event)
        finally:
            stop(child)
            reader.join()
            close_pipes(child)
    outcome = next((message for message in messages if "event" not in message), None)
    if outcome is None:
        raise _death(job, child.returncode, log_file)
    if "error" in outcome:
        raise NativeJobError(f"Stage {job!r} failed: {outcome['error']}", hint=f"Details are in {log_file}.")
    return outcome["result"]


def _death(job: str, status: int, log_file: Path) -> ProcessDiedError:
    """The error for a child that ended with ``status`` (minus the signal that ended it) and no result."""
    if status in _KILLED:
        hint = f"Somebody killed it, or memory ran out: use fewer or smaller images. See {log_file}."
    else:
        hint = f"pycolmap crashed. Its last output is in {log_file}."
    how = f"exit status {status}" if status >= 0 else f"signal {signal.Signals(-status).name}"
    message = f"The process of stage {job!r} died ({how})."
    return ProcessDiedError(message, how=how, crashed=status not in _KILLED, hint=hint)


def _read(child: "subprocess.Popen[str]", messages: list[dict[str, Any]]) -> None:
    assert child.stdout is not None
    for line in child.stdout:
        if line.startswith("{"):
            messages.append(json.loads(line))  # noqa: PERF401 - another thread reads them meanwhile


def _wait(
    child: "subprocess.Popen[str]",
    messages: list[dict[str, Any]],
    monitor: Monitor,
    on_tick: Progress | None,
    on_event: Callable[[int], None] | None,
) -> None:
    seen = 0
    last_tick = 0.0
    while True:
        try:
            child.wait(timeout=_POLL_S)
            return
        except subprocess.TimeoutExpired:
            monitor.check()
        if on_event is not None:
            for message in messages[seen:]:
                if "event" in message:
                    on_event(int(message["event"]))
        seen = len(messages)
        if on_tick is not None and time.monotonic() - last_tick >= _TICK_S:
            on_tick()
            last_tick = time.monotonic()
