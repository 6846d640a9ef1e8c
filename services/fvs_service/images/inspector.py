"""The children that look at uploads: whatever a file does to its decoder happens to them.

Each child may use so much memory and, per image, so much time; then it dies, and the image is unreadable. A
child that outlives its parent ends itself.
"""

import contextlib
import ctypes
import multiprocessing
import os
import resource
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import structlog

from fvs_service.images.inspection import Inspection, InspectionLimits, inspect
from fvs_service.images.model import Verdict

_log = structlog.get_logger()

_KEPT_BYTES = 256_000_000
"""Memory that a child keeps from one image for the next: to have it from the kernel again and again takes a
third of an inspection."""
_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
"""Of ``mallopt`` (glibc)."""

_ATTEMPTS = 2
"""A file that was looked at beside another that killed its child deserves a second look, alone."""

_KILLED = Inspection(
    Verdict.UNREADABLE,
    "Decoding it took more memory or time than an image may.",
    "Open it in an image editor and save it as JPEG.",
)


class Inspector:
    """A pool of ``children`` processes; ``inspect`` may be called from any thread, and blocks."""

    def __init__(self, limits: InspectionLimits, *, children: int, cpu_s: float, memory_bytes: int) -> None:
        self._limits = limits
        self._children, self._cpu_s, self._memory_bytes = children, cpu_s, memory_bytes
        self._lock = threading.Lock()
        self._alone = threading.Lock()
        self._pool = self._start()

    def inspect(self, path: Path) -> Inspection:
        """Judge the file at ``path``."""
        try:
            return self._submit(path)[1].result()
        except BrokenProcessPool:
            pass
        with self._alone:  # of files that fell together, each is now looked at by itself
            for _ in range(_ATTEMPTS - 1):
                pool, answer = self._submit(path)
                try:
                    return answer.result()
                except BrokenProcessPool:
                    self._replace(pool)
        return _KILLED

    def close(self) -> None:
        """End the children."""
        self._pool.shutdown(cancel_futures=True)

    def _submit(self, path: Path) -> tuple[ProcessPoolExecutor, Future[Inspection]]:
        pool = self._pool
        try:
            return pool, pool.submit(_inspect_within, path, self._limits, self._cpu_s)
        except BrokenProcessPool:
            self._replace(pool)
            return self._pool, self._pool.submit(_inspect_within, path, self._limits, self._cpu_s)

    def _start(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(
            self._children,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_limit_child,
            initargs=(os.getpid(), self._memory_bytes),
        )
        for _ in range(
            self._children
        ):  # a child starts when it is first needed, which no image should wait for
            pool.submit(os.getpid)
        return pool

    def _replace(self, broken: ProcessPoolExecutor) -> None:
        with self._lock:
            if self._pool is broken:
                _log.warning("a child that looked at an image died")
                self._pool = self._start()
        broken.shutdown(wait=False, cancel_futures=True)


def _limit_child(parent: int, memory_bytes: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(OSError, AttributeError):  # other C libraries have nothing of the kind
        c_library = ctypes.CDLL(None)
        c_library.mallopt(_M_MMAP_MAX, 0)
        c_library.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
    threading.Thread(target=_die_with, args=(parent,), daemon=True).start()


def _die_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _inspect_within(path: Path, limits: InspectionLimits, cpu_s: float) -> Inspection:
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    used = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(used + cpu_s) + 1, hard))
    return inspect(path, limits)
