"""Child processes that end with their parent.

A child is spawned, not forked: a fork of a process with threads inherits their locks. It gets a session of
its own, because Ctrl-C in a terminal goes to the whole process group, and only the parent may end its
children. The first line on its standard input is its order, a JSON document; the pipe stays open.
"""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any

EXIT_ORPHANED = 3
"""Exit status of a child whose parent is gone."""

_PR_SET_PDEATHSIG = 1
_WATCH_S = 1.0

STOP_PATIENCE_S = 3.0
"""How long a child may take to end on SIGTERM before it is killed."""


def spawn(
    module: str,
    order: str | None = None,
    *,
    arguments: Sequence[str] = (),
    stdout: int | IO[Any] | None = subprocess.PIPE,
    stderr: int | IO[Any] | None = None,
    environment: Mapping[str, str] | None = None,
) -> "subprocess.Popen[str]":
    """Start ``python -m module arguments…``, with ``environment`` added to this process's own.

    With an ``order`` standard input is a pipe that stays open after it; without one it is empty.
    Raises ``OSError`` when no process can be made.
    """
    child = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.DEVNULL if order is None else subprocess.PIPE,
        stdout=stdout,
        stderr=stderr,
        env=None if environment is None else {**os.environ, **environment},
        text=True,
        start_new_session=True,
    )
    if order is not None:
        write(child, order + "\n")
    return child


def write(child: "subprocess.Popen[str]", text: str) -> None:
    """Write to the child's standard input; raises nothing when the child has died: callers poll for that."""
    assert child.stdin is not None
    with contextlib.suppress(OSError, ValueError):
        child.stdin.write(text)
        child.stdin.flush()


def first_line(
    child: "subprocess.Popen[str]", timeout_s: float, give_up: Callable[[], bool], poll_s: float = 0.1
) -> str:
    """The first line that the child writes to standard output, without its end.

    Empty when the child ends first, writes nothing within ``timeout_s``, or when ``give_up``, which is called
    every ``poll_s``, returns True.
    """
    stdout = child.stdout
    assert stdout is not None
    lines: list[str] = []
    reader = threading.Thread(target=lambda: lines.append(stdout.readline()), daemon=True)
    reader.start()
    until = time.monotonic() + timeout_s
    while reader.is_alive() and time.monotonic() < until and not give_up():
        reader.join(poll_s)
    return lines[0].strip() if lines else ""


def stop(child: "subprocess.Popen[str]", patience_s: float = STOP_PATIENCE_S) -> None:
    """End the child: SIGTERM, and SIGKILL when it has not ended in time. Returns when it has."""
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(timeout=patience_s)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def close_pipes(child: "subprocess.Popen[str]") -> None:
    """Close our ends of the pipes of a child that has ended."""
    for pipe in (child.stdin, child.stdout, child.stderr):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()


def end_with_parent(parent: int, *, kernel: bool = True) -> None:
    """In a child: end when ``parent``, the process that made this one, has ended.

    The kernel kills the child at once where it can (Linux). It does so when the *thread* that made the child
    ends, so children of short-lived threads take ``kernel=False``: only the polling of the parent's id, once
    a second, is left.
    """
    if kernel:
        kill_with_parent(parent)
    _require_parent(parent)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def kill_with_parent(parent: int) -> None:
    """In a child: have the kernel kill it when the thread of ``parent`` that made it ends (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    _require_parent(parent)  # which may have ended before prctl took effect


def _require_parent(parent: int) -> None:
    if os.getppid() != parent:
        os._exit(EXIT_ORPHANED)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(EXIT_ORPHANED)
