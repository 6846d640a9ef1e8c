"""Run pycolmap in a child process that can be stopped, watched and silenced.

pycolmap holds on in C++ for tens of seconds, and not all of it takes a cancellation token (global mapping and
the calibration of the view graph do not); a process can always be stopped. The child is spawned, never
forked: a fork of a process with threads inherits their locks. It dies with its parent, because it watches the
pipe that is its standard input. What the C++ prints goes to a log file.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TextIO

from fvs_engine.errors import ProcessDiedError, ReconstructionError
from fvs_engine.monitor import Monitor

_COMMAND = [sys.executable, "-m", "fvs_engine.sfm.native.child"]
_POLL_S = 0.1
_PATIENCE_S = 3.0
"""How long a child may take to die of SIGTERM before it is killed."""

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
    """Run ``job`` (see ``native_jobs.find_job``) with JSON ``arguments`` in a child; returns its JSON result.

    ``on_tick`` is called a few times a second while the child works, ``on_event`` with each number that it
    reports. Raises ``Cancelled`` when the monitor says so: the child is dead by then; and
    ``ReconstructionError`` when the job fails, ``ProcessDiedError`` when its process dies.
    """
    monitor.check()
    log_file.parent.mkdir(parents=True, exist_ok=True)
    with log_file.open("a", encoding="utf-8") as log:
        log.write(f"== {job} {json.dumps(dict(arguments))}\n")
        log.flush()
        child = _spawn(log)
        messages: list[dict[str, Any]] = []
        reader = threading.Thread(target=_read, args=(child, messages), daemon=True)
        reader.start()
        try:
            _send(child, {"job": job, "arguments": dict(arguments)})
            _wait(child, messages, monitor, on_tick, on_event)
        finally:
            _stop(child)
            reader.join()
            _close(child)
    outcome = next((message for message in messages if "event" not in message), None)
    if outcome is None:
        raise ProcessDiedError(
            f"The process of stage {job!r} died (exit status {child.returncode}).",
            hint=f"Often memory ran out: use fewer or smaller images. Its last words are in {log_file}.",
        )
    if "error" in outcome:
        raise ReconstructionError(
            f"Stage {job!r} failed: {outcome['error']}", hint=f"Details are in {log_file}."
        )
    return outcome["result"]


def _spawn(log: TextIO) -> "subprocess.Popen[str]":
    environment = os.environ | {"GLOG_minloglevel": "0", "GLOG_logtostderr": "1"}
    return subprocess.Popen(
        _COMMAND,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
        env=environment,
        # Ctrl-C in a terminal goes to the whole group: the parent alone decides when its child ends.
        start_new_session=True,
    )


def _send(child: "subprocess.Popen[str]", order: Mapping[str, Any]) -> None:
    assert child.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it died at once; its missing answer says so
        child.stdin.write(json.dumps(order) + "\n")
        child.stdin.flush()  # and stays open: its end tells the child that its parent is gone


def _read(child: "subprocess.Popen[str]", messages: list[dict[str, Any]]) -> None:
    assert child.stdout is not None
    for line in child.stdout:
        if line.startswith("{"):
            messages.append(json.loads(line))  # noqa: PERF401 - another thread reads them as they come


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
        if on_tick is not None and time.monotonic() - last_tick >= 3 * _POLL_S:
            on_tick()
            last_tick = time.monotonic()


def _stop(child: "subprocess.Popen[str]") -> None:
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def _close(child: "subprocess.Popen[str]") -> None:
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
