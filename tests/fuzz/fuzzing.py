"""Mutation fuzzing of parsers of files, in a child process: crashes, hangs and memory are found and counted.

A case is a number: it chooses a seed file and its mutations, so that a finding can be repeated by its number
alone. A child that dies or hangs is replaced, and goes on after the case that killed it.
"""

import argparse
import faulthandler
import json
import math
import multiprocessing
import random
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from fvs_engine.errors import EngineError

Files = Mapping[str, bytes]
"""Name → content: the files of one input."""

MEMORY_BYTES = 500_000_000
"""Memory limit of a parser for one input; all inputs are a few kB."""
CPU_S = 10
"""A case that takes longer hangs."""

_NUMBERS = (
    *(b"0", b"-1", b"1e308", b"-1e308", b"1e400", b"nan", b"NaN", b"inf", b"-Infinity", b"1e-320", b"null"),
    *(b"2147483648", b"4294967295", b"18446744073709551615", b"9" * 40, b'""', b"[]", b"{}", b"true"),
)
_WORDS = (
    *(
        number.to_bytes(size, "little", signed=number < 0)
        for size in (1, 2, 4, 8)
        for number in (0, 1, -1, 2 ** (8 * size - 1) - 1, -(2 ** (8 * size - 1)), 0x7F, 100)
    ),
    *(struct.pack(kind, value) for kind in "fd" for value in (math.nan, math.inf, 1e30)),
)


@dataclass(frozen=True)
class Target:
    """A parser: ``seeds`` are valid inputs, ``parse`` reads the files that are in a folder."""

    name: str
    seeds: Callable[[Path], list[Files]]
    parse: Callable[[Path], object]


@dataclass
class Report:
    """What the cases of one target came to; ``findings`` has the case and its trace."""

    target: str
    cases: int = 0
    accepted: int = 0
    refused: int = 0
    cpu_s: float = 0.0
    peak_bytes: int = 0
    crashes: int = 0
    hangs: int = 0
    memory: int = 0
    findings: list[str] = field(default_factory=list)

    @property
    def clean(self) -> bool:
        """Whether nothing was found."""
        return not (self.crashes or self.hangs or self.memory)


def mutated(seeds: list[Files], case: int) -> Files:
    """The files of a case."""
    chance = random.Random(case)
    files = dict(chance.choice(seeds))
    name = chance.choice(sorted(files))
    content = bytearray(files[name])
    for _ in range(chance.choice((1, 1, 1, 2, 4, 16))):
        _mutate(content, chance, seeds, name)
    files[name] = bytes(content)
    return files


def _mutate(content: bytearray, chance: random.Random, seeds: list[Files], name: str) -> None:
    here = chance.randrange(len(content) + 1)
    match chance.randrange(9):
        case 0:
            del content[here:]
        case 1:
            del content[here : here + chance.choice((1, 2, 4, 8, 64))]
        case 2:
            content[here:here] = chance.randbytes(chance.choice((1, 2, 4, 8)))
        case 3:
            content[here : here + 1] = chance.randbytes(1)
        case 4:
            word = chance.choice(_WORDS)
            content[here : here + len(word)] = word
        case 5:
            start, stop = _token(content, here)
            content[start:stop] = chance.choice(_NUMBERS)
        case 6:
            start, stop = _token(content, here)
            content[here:here] = b" " + content[start:stop]
        case 7:
            other = chance.choice(seeds).get(name, b"")
            start = chance.randrange(len(other) + 1)
            content[here : here + 32] = other[start : start + 32]
        case 8:
            header = chance.randrange(min(64, len(content)) + 1)
            word = chance.choice(_WORDS)
            content[header : header + len(word)] = word


def _token(content: bytearray, here: int) -> tuple[int, int]:
    """Where the number or word around a position begins and ends."""
    inside = b"0123456789.+-eEabcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_"
    start = stop = here
    while start > 0 and content[start - 1] in inside:
        start -= 1
    while stop < len(content) and content[stop] in inside:
        stop += 1
    return start, stop


def fuzz(
    target: Target, *, cases: int, cpu_s: float = float("inf"), first: int = 0, start: str = "spawn"
) -> Report:
    """Run so many cases from the number ``first`` on, or as many as fit into ``cpu_s`` of processor time.

    ``start`` is how children are made, as in ``multiprocessing``; a process with threads can only spawn.
    """
    report, case, stop = Report(target.name), first, first + cases
    context: Any = multiprocessing.get_context(start)
    while case < stop and report.cpu_s < cpu_s:
        ours, its = context.Pipe()
        span = (case, stop, cpu_s - report.cpu_s)
        child = context.Process(target=_run, args=(target, its, span), daemon=True)
        child.start()
        its.close()
        try:
            case = _collect(report, ours, case, stop)
        except KeyboardInterrupt:  # the report so far
            case = stop
            ours.close()
        if ours.closed or child.is_alive():
            child.kill()
        child.join()
    return report


def fuzz_all(targets: Sequence[Target], *, cases: int) -> list[Report]:
    """Fuzz targets in forks of one child: it imports what they need once."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_fuzz_in_forks, targets, cases).result()


def _fuzz_in_forks(targets: Sequence[Target], cases: int) -> list[Report]:
    return [fuzz(target, cases=cases, start="fork") for target in targets]


def _collect(report: Report, messages: Connection, case: int, stop: int) -> int:
    """Add a child's messages to the report until it ends; returns the next case."""
    while True:
        try:
            if not messages.poll(30 * CPU_S):
                report.hangs += 1
                report.findings.append(f"case {case} hangs outside Python")
                messages.close()
                return case + 1
            message = messages.recv()
        except EOFError:
            report.crashes += 1
            report.findings.append(f"case {case} killed the process")
            return case + 1
        if message is None:  # it is done, or out of time
            return stop
        case = message["case"]
        if "outcome" not in message:
            continue
        report.cases += 1
        report.cpu_s += message["cpu_s"]
        report.peak_bytes = max(report.peak_bytes, message["peak_bytes"])
        outcome = message["outcome"]
        setattr(report, outcome, getattr(report, outcome) + 1)
        if message["trace"]:
            report.findings.append(f"case {case}: {message['trace']}")
        case += 1


def _run(target: Target, messages: Connection, span: tuple[int, int, float]) -> None:
    """The child: tells which case it starts, and how it ended."""
    faulthandler.enable()
    signal.signal(signal.SIGALRM, _stuck)
    first, stop, cpu_s = span
    with tempfile.TemporaryDirectory() as name:
        seeds = target.seeds(Path(name) / "seeds")
        folder = Path(name) / "input"
        folder.mkdir()
        target_run = _measured(target, seeds[0], folder)  # what is loaded at first use is no case's
        started = last = time.process_time()
        for case in range(first, stop):
            messages.send({"case": case})
            message = _measured(target, mutated(seeds, case), folder)
            now = time.process_time()
            messages.send({"case": case, **message, "cpu_s": now - last})
            last = now
            if now - started > cpu_s:
                break
        assert target_run["outcome"] == "accepted", target_run
    messages.send(None)


def _measured(target: Target, files: Files, folder: Path) -> dict[str, object]:
    for old in folder.iterdir():
        old.unlink()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    before, started, trace = _peak_bytes(), time.process_time(), ""
    signal.alarm(20 * CPU_S)
    try:
        target.parse(folder)
        outcome = "accepted"
    except EngineError:
        outcome = "refused"
    except TimeoutError:
        outcome, trace = "hangs", traceback.format_exc(limit=-4)
    except MemoryError:
        outcome, trace = "memory", traceback.format_exc(limit=-4)
    except BaseException:
        outcome, trace = "crashes", traceback.format_exc(limit=-6)
    signal.alarm(0)
    cpu_s, taken = time.process_time() - started, _peak_bytes() - before
    if outcome in ("accepted", "refused") and taken > MEMORY_BYTES:
        outcome, trace = "memory", f"{taken / 1e9:.1f} GB"
    elif outcome in ("accepted", "refused") and cpu_s > CPU_S:
        outcome, trace = "hangs", f"{cpu_s:.0f} s"
    return {"outcome": outcome, "cpu_s": cpu_s, "peak_bytes": taken, "trace": trace}


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _stuck(_number: int, _frame: object) -> None:
    raise TimeoutError


def run(targets: Sequence[Target], description: str | None) -> int:
    """Fuzz the targets that the command line names, all by default; the exit status is 1 for findings."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("targets", nargs="*", choices=[[], *(target.name for target in targets)])
    options.add_argument("--minutes", type=float, default=20.0, help="processor time per target")
    options.add_argument("--first", type=int, default=0, help="number of the first case")
    given = options.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    clean = True
    for target in targets:
        if not given.targets or target.name in given.targets:
            report = fuzz(target, cases=10**9, cpu_s=60 * given.minutes, first=given.first)
            sys.stdout.write(json.dumps(asdict(report)) + "\n")
            sys.stdout.flush()
            clean = clean and report.clean
    return 0 if clean else 1
