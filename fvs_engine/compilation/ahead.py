"""Compile the kernels before they are used, in another process, so that every process runs the same code.

Numba optimises a kernel that it has just compiled differently from the copy in its cache, and their results
differ in the last bits. So no process runs a kernel that it compiled itself. A *warm-up* is a module that
calls every kernel of a package once (``STEPS``); where the cache lacks something, a short-lived child process
runs it, and every process loads the kernels from the cache.

A *stamp* beside the cache lists what the cache held when a warm-up ended: the kernels' source files and the
compiled ones, with their times. Checking it takes a millisecond. It also reveals a change that Numba itself
overlooks, in a kernel or constant that another file imports: that file is then compiled again, too.
"""

import ast
import contextlib
import hashlib
import importlib
import json
import logging
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, cast

import numba
from numba.core.registry import cpu_target

from fvs_engine import child_process
from fvs_engine.compilation.kernels import KERNELS, cache_folder
from fvs_engine.monitor import Monitor
from fvs_schema.stages import Stage

_POLL_S = 0.1
_log = logging.getLogger(__name__)
_ready: set[str] = set()
_one_at_a_time = threading.Lock()


class WarmUp(Protocol):
    """A module that calls every kernel of its package, with every signature that the package uses."""

    STEPS: Sequence[Callable[[], None]]


def ensure_compiled(warm_up: str, kernel: Callable[..., Any], monitor: Monitor | None = None) -> None:
    """Fill the cache with the kernels that the module named ``warm_up`` calls. Stage ``compile``.

    ``kernel`` is one of them: the stamp lies beside its cache. Takes tens of seconds the first time on a
    machine, a millisecond later. Without a cache, or when the child fails, there is only a line in the log:
    kernels are then compiled when they are first called, and results equal those of other processes only up
    to rounding. Raises ``Cancelled``; what was compiled by then stays.
    """
    with _one_at_a_time:
        if warm_up in _ready:
            return
        stamp = _stamp_of(warm_up, kernel)
        if stamp is not None and not is_valid(stamp):
            _compile_in_child(warm_up, stamp, monitor or Monitor())
        _ready.add(warm_up)


def _stamp_of(warm_up: str, kernel: Callable[..., Any]) -> Path | None:
    """The path of a warm-up's stamp, for this processor and these versions; None without a cache."""
    folder = cache_folder(kernel)
    if folder is None:
        return None
    target = cast(Any, cpu_target.target_context).codegen().magic_tuple()  # what Numba's cache is keyed by
    key = repr((numba.__version__, sys.implementation.cache_tag, target))
    return folder / f"{warm_up}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.json"


def is_valid(stamp: Path) -> bool:
    """Whether all files that the stamp lists are unchanged."""
    try:
        seen = json.loads(stamp.read_text(encoding="utf-8"))
        return all(_state(Path(name)) == state for files in seen.values() for name, state in files.items())
    except (OSError, ValueError):
        return False


def run_warm_up(warm_up: str, stamp: Path, on_step: Callable[[int, int], None]) -> None:
    """Run the warm-up in this process and write its stamp; only the child process does so."""
    _ready.add(warm_up)  # its steps call ``ensure_compiled``
    module = cast(WarmUp, importlib.import_module(warm_up))
    folders = _cache_folders(warm_up.rpartition(".")[0])
    imports = {source: _imported_files(source, warm_up.partition(".")[0]) for source in folders}
    sources = {Path(cast(Any, module).__file__), *folders}.union(*imports.values())
    for source in _stale(imports, _changed(sources, stamp)):
        for compiled in _compiled(source, folders[source]):
            compiled.unlink(missing_ok=True)
    for done, step in enumerate(module.STEPS, start=1):
        step()
        on_step(done, len(module.STEPS))
    # Not the index files: another kind of processor that shares the cache adds its entries to them.
    data = [p for kernel in folders.items() for p in _compiled(*kernel) if p.suffix == ".nbc"]
    seen = {
        "sources": {str(path): _state(path) for path in sources},
        "data": {str(path): _state(path) for path in data},
    }
    partial = stamp.with_suffix(".partial")
    partial.write_text(json.dumps(seen), encoding="utf-8")
    partial.replace(stamp)


def _cache_folders(package: str) -> dict[Path, Path]:
    """The source files of a package's kernels, and the folders of their compiled code."""
    kernels = [kernel for kernel in KERNELS if kernel.__module__.startswith(f"{package}.")]
    folders = {Path(kernel.__code__.co_filename): cache_folder(kernel) for kernel in kernels}
    return {source: folder for source, folder in folders.items() if folder is not None}


def _imported_files(source: Path, package: str) -> set[Path]:
    """The files of a (top) package that a kernel's file takes constants and other kernels from."""
    names = set()
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == package:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    files = {getattr(sys.modules.get(name), "__file__", None) for name in names}
    return {Path(file) for file in files if file is not None}


def _changed(sources: Collection[Path], stamp: Path) -> set[Path]:
    """The sources that changed since an earlier stamp; none when there is no earlier one."""
    try:
        known = json.loads(stamp.read_text(encoding="utf-8"))["sources"]
        return {source for source in sources if known.get(str(source)) != _state(source)}
    except FileNotFoundError:
        return set()
    except (ValueError, KeyError):
        return set(sources)


def _stale(imports: Mapping[Path, Collection[Path]], changed: Collection[Path]) -> set[Path]:
    """The kernels' files that changed, or take something from one that did, or from a stale one."""
    stale: set[Path] = set()
    while True:
        suspects = stale.union(changed)
        more = {source for source, files in imports.items() if suspects.intersection((source, *files))}
        if more == stale:
            return stale
        stale = more


def _state(path: Path) -> list[int]:
    status = path.stat()
    return [status.st_mtime_ns, status.st_size]


def _compiled(source: Path, folder: Path) -> list[Path]:
    """The index (.nbi) and data (.nbc) files of one source file's kernels."""
    return [path for path in folder.glob(f"{source.stem}.*") if path.suffix in {".nbi", ".nbc"}]


def _compile_in_child(warm_up: str, stamp: Path, monitor: Monitor) -> None:
    monitor.check()
    monitor.report(Stage.COMPILE, 0)
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as complaints:
        order = json.dumps({"warm_up": warm_up, "stamp": str(stamp)})
        try:
            child = child_process.spawn("fvs_engine.compilation.child", order, stderr=complaints)
        except OSError as error:
            _log.warning("No process for compiling the kernels: %s.", error)
            return
        steps: list[str] = []
        reader = threading.Thread(target=_read, args=(child, steps), daemon=True)
        reader.start()
        try:
            _wait(child, steps, monitor)
        finally:
            child_process.stop(child)
            reader.join()
            child_process.close_pipes(child)
        if child.returncode != 0:
            complaints.seek(0)
            last = complaints.read().strip().rpartition("\n")[2]
            _log.warning("Compiling the kernels ahead failed (%s): they are compiled on the way.", last)


def _read(child: "subprocess.Popen[str]", steps: list[str]) -> None:
    steps.extend(iter(cast(Any, child.stdout).readline, ""))


def _wait(child: "subprocess.Popen[str]", steps: list[str], monitor: Monitor) -> None:
    seen = 0
    while child.poll() is None:
        monitor.check()
        if len(steps) > seen:
            seen = len(steps)
            done, total = steps[-1].split()
            monitor.report(Stage.COMPILE, int(done), int(total))
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(_POLL_S)
