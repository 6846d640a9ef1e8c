"""Decorators of the CPU kernels: one set of Numba options, one thread-safe threading layer.

Every kernel of the engine is decorated with ``kernel`` (single-threaded) or ``parallel_kernel``. The
options, and why:

* ``fastmath`` without ``nnan``/``ninf``: kernels may meet non-finite numbers and must carry them on.
* ``error_model="numpy"``: a division by zero is inf, not a branch that stops vectorisation.
* ``nogil``: a ranking may run while training does.
* ``cache``: a second process start compiles nothing. (Nor does the first, see ``ahead``.)
"""

import ctypes
import importlib.metadata
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import config as _numba_config

_Function = TypeVar("_Function", bound=Callable[..., Any])

_config = cast(Any, _numba_config)  # its settings are made at import time, where no type checker sees them

F = cast(Callable[[float], float], np.float32)
"""A float32 constant in a kernel, ``F(0.5)``: one float64 literal halves the speed of a loop."""

KERNELS: list[Any] = []
"""All kernels of the modules that are imported: Numba's dispatchers, or functions where Numba is off."""

_KEPT_BYTES = 1 << 28

_OPTIONS: dict[str, Any] = {
    "fastmath": {"contract", "nsz", "arcp", "reassoc"},
    "error_model": "numpy",
    "nogil": True,
}


def _use_thread_safe_layer() -> None:
    """Select TBB (or OpenMP): the default layer aborts when two threads enter kernels at once.

    The ``tbb`` wheel puts its library where the loader does not look, so it is loaded by path first.
    """
    try:
        files = importlib.metadata.files("tbb") or []
        library = next(str(f.locate()) for f in files if f.name.startswith("libtbb.so.12"))
        ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL)
    except (importlib.metadata.PackageNotFoundError, StopIteration, OSError):
        _config.THREADING_LAYER = "threadsafe"
    else:
        _config.THREADING_LAYER = "tbb"


def _keep_freed_memory() -> None:
    """Let glibc keep freed blocks of up to 256 MB for the next allocation.

    By itself it returns blocks over 32 MB to the system at once; every training step would page its
    gradients in again, which for 350,000 Gaussians of SH degree 3 took 11 % of the step's processor time.
    """
    trim_threshold, mmap_threshold = -1, -3
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        return  # another C library, with other habits
    mallopt(mmap_threshold, _KEPT_BYTES)
    mallopt(trim_threshold, _KEPT_BYTES)


if "NUMBA_THREADING_LAYER" not in os.environ:
    _use_thread_safe_layer()
_keep_freed_memory()


def kernel(function: _Function) -> _Function:
    """Compile a single-threaded kernel on its first call."""
    return _compiled(function)


def inlined_kernel(function: _Function) -> _Function:
    """Compile a kernel that LLVM must inline, whatever its size: for a few lines called in a hot loop."""
    return _compiled(function, forceinline=True)


def parallel_kernel(function: _Function) -> _Function:
    """Compile a kernel whose ``prange`` loops run on all threads of the process's budget."""
    return _compiled(function, parallel=True)


def _compiled(function: _Function, **options: bool) -> _Function:
    njit = cast(Any, numba.njit)
    try:
        compiled = njit(cache=True, **options, **_OPTIONS)(function)
    except RuntimeError:  # no folder to keep it in: neither beside the source nor in the user's home
        compiled = njit(**options, **_OPTIONS)(function)
    KERNELS.append(compiled)
    return cast(_Function, compiled)


def cache_folder(kernel: Callable[..., Any]) -> Path | None:
    """The folder of a kernel's compiled code; None where Numba keeps none."""
    stats = getattr(kernel, "stats", None)
    return None if stats is None or stats.cache_path is None else Path(stats.cache_path)


def set_thread_budget(threads: int) -> None:
    """Give Numba's kernels ``threads`` threads (at most what the process started with)."""
    numba.set_num_threads(max(1, min(threads, _config.NUMBA_NUM_THREADS)))
