"""Measurement and reporting for all benchmarks: the machine, repeated timings, a table and JSON."""

import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import torch
from rich.console import Console
from rich.table import Table

ISA = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512bw", "avx512vl", "asimd", "sve")
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "torch", "pycolmap", "gsplat")


@dataclass(frozen=True)
class Timing:
    """Time of ``repeat`` runs in seconds."""

    min_s: float
    median_s: float
    max_s: float
    repeat: int

    def __str__(self) -> str:
        units = ((1.0, "s"), (1e3, "ms"), (1e6, "µs"))
        factor, unit = next((unit for unit in units if unit[0] * self.median_s >= 1), units[-1])
        return " / ".join(f"{factor * t:.3g}" for t in (self.min_s, self.median_s, self.max_s)) + f" {unit}"


def measure(
    function: Callable[[], Any],
    repeat: int = 7,
    warmup: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> Timing:
    """Time ``function``, including the work on the GPU that it leaves running."""
    return measure_side_by_side({"": function}, repeat, warmup, clock)[""]


def measure_side_by_side(
    functions: Mapping[str, Callable[[], Any]],
    repeat: int = 7,
    warmup: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Time several functions in turns, so that a drift of the machine's speed affects all of them.

    ``clock`` returns the time in seconds: ``time.process_time`` counts what this process alone computes.
    """
    seconds: dict[str, list[float]] = {name: [] for name in functions}
    for turn in range(warmup + repeat):
        for name, function in functions.items():
            _wait_for_gpu()
            start = clock()
            function()
            _wait_for_gpu()
            if turn >= warmup:
                seconds[name].append(clock() - start)
    return {name: Timing(min(times), median(times), max(times), repeat) for name, times in seconds.items()}


def machine() -> dict[str, Any]:
    """Cores, instruction sets, memory, GPU and versions of the machine."""
    flags = _processor_field("flags", "Features").split()
    cuda = torch.cuda.is_available()
    return {
        "processor": _processor_field("model name", "Hardware") or platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "isa": [name for name in ISA if name in flags],
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "gpu": torch.cuda.get_device_name() if cuda else None,
        "torch_threads": torch.get_num_threads(),
        "load_before": os.getloadavg()[0],
        "python": platform.python_version(),
        **{name: version for name in LIBRARIES if (version := _version(name))},
    }


def report(name: str, rows: Sequence[Mapping[str, Any]], path: Path | None = None) -> None:
    """Print the machine and ``rows`` as a table; write both to ``path`` as JSON when there is one.

    Each row maps column → number, text or ``Timing`` (shown as min / median / max).
    """
    about = machine()
    console = Console(width=None if Console().is_terminal else 160)
    console.print(", ".join(f"{key} {_shown(value)}" for key, value in about.items() if value is not None))
    table = Table(title=name, caption="times: min / median / max")
    columns = list(dict.fromkeys(column for row in rows for column in row))
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*(_shown(row.get(column, "")) for column in columns))
    console.print(table)
    if path is not None:
        plain = [
            {key: asdict(value) if isinstance(value, Timing) else value for key, value in row.items()}
            for row in rows
        ]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"benchmark": name, "machine": about, "rows": plain}, indent=1) + "\n")


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return "+".join(value) if isinstance(value, list) else str(value)


def _processor_field(*names: str) -> str:
    """The first of the fields that /proc/cpuinfo has; empty elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    fields = (line.partition(":") for line in lines)
    return next((value.strip() for key, _, value in fields if key.strip() in names), "")


def _version(library: str) -> str | None:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return None


def _wait_for_gpu() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()
