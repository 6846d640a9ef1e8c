"""The processes below one (Linux: from ``/proc``; elsewhere none are found)."""

import contextlib
import ctypes
import os
import signal
import time
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

_PR_SET_CHILD_SUBREAPER = 36
_POLL_S = 0.02


def descendants(pid: int) -> tuple[int, ...]:
    """The ids of the processes below ``pid``, without those that have ended.

    One has ended when its last thread has: until then it may have children, whatever the state of its first.
    """
    processes = tuple(_processes())
    parents = {child: parent for child, parent, _ in processes}
    return tuple(
        child
        for child, _, running in processes
        if running and child != pid and _is_above(pid, child, parents)
    )


def command_of(pid: int) -> str:
    """The command line of a process; empty when there is none."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().replace("\0", " ")
    return ""


def adopt_orphans() -> None:
    """Become the parent of processes below this one whose own parent dies, so that none is out of reach."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def reap_adopted(own: Collection[int]) -> None:
    """Reap ended children that were adopted: their ids are not in ``own``."""
    with contextlib.suppress(ChildProcessError):  # there are no children
        while ended := os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            if ended.si_pid in own:
                return
            os.waitpid(ended.si_pid, 0)


def kill_descendants() -> None:
    """Send SIGKILL to all processes below this one."""
    for pid in descendants(os.getpid()):
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)


def end_descendants(timeout_s: float) -> None:
    """Kill all processes below this one, and wait until they have ended, but not longer than ``timeout_s``.

    Their parents must have been waited for, and those who adopt orphans find all (see ``adopt_orphans``).
    """
    until = time.monotonic() + timeout_s
    while descendants(os.getpid()) and time.monotonic() < until:
        kill_descendants()
        reap_adopted(())
        time.sleep(_POLL_S)
    reap_adopted(())


def _processes() -> Iterator[tuple[int, int, bool]]:
    """Every process's id, its parent's, and whether a thread of it runs."""
    proc = Path("/proc")
    for folder in proc.iterdir() if proc.is_dir() else ():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):  # the process has ended
                state, parent, *_ = (folder / "stat").read_text().rsplit(")", 1)[1].split()
                running = state not in "ZX" or len(list((folder / "task").iterdir())) > 1
                yield int(folder.name), int(parent), running


def _is_above(ancestor: int, pid: int, parents: Mapping[int, int]) -> bool:
    seen = set()  # ids that are given again while they are read may make a ring
    while pid != ancestor and pid in parents and pid not in seen:
        seen.add(pid)
        pid = parents[pid]
    return pid == ancestor
