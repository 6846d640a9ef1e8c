"""Processor time of processes; that of other processes is read from ``/proc`` (Linux)."""

import os
from pathlib import Path

from fvs_service.serving.process_tree import descendants

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def so_far_s() -> float:
    """Processor time of this process and its ended children so far, in s: less noisy than wall time."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def own_s(pid: int) -> float:
    """The processor time that a process has used, all its threads together, in s."""
    return _TICK_S * sum(_times(pid)[:2])


def of_tree_s(pid: int) -> float:
    """The processor time of a process and all its descendants, also of those that have ended, in s.

    It leaves out descendants whose end nobody has waited for.
    """
    return _TICK_S * sum(sum(_times(process)) for process in (pid, *descendants(pid)))


def _times(pid: int) -> tuple[int, ...]:
    """Ticks of user and system time, its own and that of its ended children; zeros when it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except FileNotFoundError:
        return (0, 0, 0, 0)
    return tuple(map(int, fields[11:15]))
