"""Child processes that inspect uploads, because decoders crash, hang and exhaust memory on hostile files.

Each child has a memory limit and, per image, a limit of processor time. A child that exceeds one dies alone:
its image is unreadable, and another child takes its place.
"""

import contextlib
import ctypes
import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import structlog
from pebble import ProcessExpired, ProcessPool

from fvs_engine.child_process import end_with_parent
from fvs_engine.images.limits import ImageLimits
from fvs_schema.images import Verdict
from fvs_service.images.inspection import Inspection, MaskProblem, inspect, inspect_mask, inspect_video

Found = TypeVar("Found")

_log = structlog.get_logger()

_KEPT_BYTES = 256_000_000
"""Memory that a child keeps from one image for the next: returning it to the kernel and requesting it again
takes a third of an inspection."""
_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
"""Parameters of ``mallopt`` (glibc)."""
_MEMORY_PER_DECODING = 2
"""Memory that a child may take, in multiples of that for decoding."""
_CPU_S = 60.0
"""Processor time that a child may take for an image."""
_STUCK_AFTER = 10
"""A child is also killed when an inspection takes this multiple of its processor time by the clock."""

_KILLED = Inspection(
    Verdict.UNREADABLE,
    "Decoding it took more memory or time than an image may.",
    "Open it in an image editor and save it as JPEG.",
)


class Inspector:
    """A pool of ``children`` processes; ``inspect`` may be called from any thread, and blocks."""

    def __init__(self, limits: ImageLimits, *, children: int) -> None:
        self._limits = limits
        self._pool = ProcessPool(
            children,
            context=multiprocessing.get_context("spawn"),
            initializer=_prepare_child,
            initargs=(os.getpid(), int(_MEMORY_PER_DECODING * limits.max_decoding_bytes)),
        )
        self._pool.schedule(os.getpid)  # the pool starts its children with its first task

    def inspect(self, path: Path) -> Inspection:
        """Return the verdict on the file at ``path``."""
        return self._within(_KILLED, inspect, path, self._limits)

    def inspect_video(self, path: Path, longest_s: float) -> Inspection:
        """Return the verdict on a video, by its header."""
        return self._within(_KILLED, inspect_video, path, self._limits, longest_s)

    def mask_problem(self, folder: Path, name: str) -> MaskProblem | None:
        """Why the mask of the image ``name`` in ``folder`` cannot be used; None if it can be."""
        killed: MaskProblem | None = MaskProblem(_KILLED.reason, _KILLED.hint)
        return self._within(killed, inspect_mask, folder, name)

    def _within(self, killed: Found, function: Callable[..., Found], *arguments: object) -> Found:
        """The result of a function in a child; ``killed`` when that exceeded a limit."""
        task = self._pool.schedule(_run_within, (function, *arguments), timeout=_STUCK_AFTER * _CPU_S)
        try:
            found: Found = task.result()
        except (ProcessExpired, TimeoutError) as error:
            _log.warning("inspection killed", reason=str(error))
            return killed
        return found

    def close(self) -> None:
        """End the children."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()


def limit_child(parent: int, memory_bytes: int) -> None:
    """In a child of a pool: limit its memory, and end with ``parent``."""
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end_with_parent(parent, kernel=False)  # the pool's threads make the children


def _prepare_child(parent: int, memory_bytes: int) -> None:
    with contextlib.suppress(OSError, AttributeError):  # other C libraries have no mallopt
        c_library = ctypes.CDLL(None)
        c_library.mallopt(_M_MMAP_MAX, 0)
        c_library.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    limit_child(parent, memory_bytes)


def _run_within(function: Callable[..., Found], *arguments: object) -> Found:
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    used = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(used + _CPU_S) + 1, hard))
    return function(*arguments)
