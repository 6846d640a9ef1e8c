"""Run a service for long under load and kills, and measure whether its memory, files and disk stay bounded.

    python tests/faults/soak.py --minutes 120

Two clients each take scenes through their whole life, one after the other: upload, update, upload, update,
rankings, deletion. A third client's scene rests with a model, and is only ranked, so that its runner is idle.
Once a minute one process of the service is killed, but gateways and workers live for ``--live`` minutes:
only then a leak differs from a process that warms up. Every job must succeed, and every deleted scene must
leave the disk.

Every few seconds the anonymous memory and the open files of every process are sampled, and the disk's use. At
the end it prints, for each kind of process, the slope of its memory and files over the lives of its processes
(each has a level of its own) with a standard error that respects that the samples of one process are alike:
once without the first minute of each process, and once without its first quarter of an hour.
"""

import argparse
import contextlib
import json
import math
import os
import random
import signal
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from kill_anything import QUESTION, Service, delete, require_health, send, wait
from killer import Watch

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

SAMPLE_S = 5.0
WARM_S = (60.0, 900.0)
LONG_LIVED = frozenset({"gateway", "worker"})
RETENTION = {"snapshots": 2, "rankings": 20}


@dataclass(frozen=True)
class Sample:
    """One process at one time; ``age_s`` since it was first seen."""

    process: str
    pid: int
    at_s: float
    age_s: float
    memory_mb: float
    files: int


@dataclass(frozen=True)
class Slope:
    """A change per hour with its standard error; ``mean`` is the level."""

    mean: float
    per_hour: float
    error: float
    processes: int


class Sampler(threading.Thread):
    """Samples the processes and the disk until it is stopped."""

    def __init__(self, service: Service, watch: Watch, clients: "Sequence[Client]") -> None:
        super().__init__(daemon=True)
        self._service, self._watch, self._clients = service, watch, clients
        self._began = time.monotonic()
        self._seen: dict[int, float] = {}
        self._end = threading.Event()
        self.samples: list[Sample] = []
        self.disk_mb: list[tuple[float, float]] = []

    def run(self) -> None:
        """Sample regularly."""
        while not self._end.wait(SAMPLE_S):
            now = time.monotonic() - self._began
            for process, pids in self._watch.moment().processes.items():
                for pid in pids:
                    with contextlib.suppress(OSError):
                        memory_mb, files = _memory_mb(pid), len(list(Path(f"/proc/{pid}/fd").iterdir()))
                        age_s = now - self._seen.setdefault(pid, now)
                        kind = "idle runner" if self._is_idle(process, pid) else process
                        self.samples.append(Sample(kind, pid, now, age_s, memory_mb, files))
            self.disk_mb.append((now, _size_mb(self._service.root)))

    def _is_idle(self, process: str, pid: int) -> bool:
        """Whether it is the runner of the scene that rests; its standard error is in the scene's folder."""
        resting = next((client.resting for client in self._clients if client.resting), None)
        return (
            process == "runner"
            and resting is not None
            and Path(f"/proc/{pid}/fd/2").readlink().parent.name == resting
        )

    def stop(self) -> None:
        """Stop sampling."""
        self._end.set()
        self.join()


class Client(threading.Thread):
    """Repeats the life of a scene until ``until``; the first failure ends it."""

    def __init__(self, service: Service, photographs: Sequence[Path], until: float, *, rests: bool) -> None:
        super().__init__(daemon=True)
        self._service, self._photographs, self._until, self._rests = service, photographs, until, rests
        self.lives = self.rankings = 0
        self.resting: str | None = None
        self.failure: str | None = None

    def run(self) -> None:
        """Live."""
        try:
            while time.monotonic() < self._until:
                self._live()
                self.lives += 1
        except SystemExit as failure:
            self.failure = str(failure)

    def _live(self) -> None:
        request = {"name": "soak", "retention": RETENTION}
        key = {"Idempotency-Key": os.urandom(8).hex()}
        scene = self._service.call("POST", "/v1/scenes", json=request, headers=key)["id"]
        for files in (self._photographs[:7], self._photographs[7:]):
            send(self._service, scene, list(files))
            job = self._service.call("POST", f"/v1/scenes/{scene}/jobs", json={"kind": "update"})
            wait(self._service, job["id"])
            self._rank(scene, 5)
        if self._rests:
            self.resting = scene
        while self._rests and time.monotonic() < self._until:
            self._rank(scene, 1)
            time.sleep(2.0)
        delete(self._service, scene)

    def _rank(self, scene: str, times: int) -> None:
        for _ in range(times):
            self._service.call("POST", f"/v1/scenes/{scene}/rankings", json=QUESTION)
            self.rankings += 1


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--kill-every", type=float, default=60.0, metavar="S")
    parser.add_argument("--live", type=float, default=40.0, metavar="MIN", help="of gateways and workers")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, help="a new folder to work in, which is kept with all logs")
    parser.add_argument("--json", type=Path, help="write all samples")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with contextlib.ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fvs-soak-")))
        camera = SimulatedCamera.like_a_drone(320, 240)
        photographs = write_photographs(
            folder / "world", courtyard(), camera, orbit(9, turns=0.36), Monitor()
        )
        service = stack.enter_context(Service(folder / "service", 1))
        watch = Watch(service.process.pid, service.root / "fvs.sqlite3")
        until = time.monotonic() + 60 * options.minutes
        clients = [Client(service, photographs, until, rests=number == 2) for number in range(3)]
        sampler = Sampler(service, watch, clients)
        for thread in (sampler, *clients):
            thread.start()
        kills, spared_until = 0, dict.fromkeys(LONG_LIVED, time.monotonic() + 60 * options.live)
        while time.monotonic() < until and not any(client.failure for client in clients):
            time.sleep(options.kill_every)
            killed = _kill(watch, rng, {kind for kind, at in spared_until.items() if time.monotonic() < at})
            kills += killed is not None
            if killed in spared_until:
                spared_until[killed] = time.monotonic() + 60 * options.live
        for client in clients:
            client.join()
        sampler.stop()
        failures = [client.failure for client in clients if client.failure]
        if not failures:
            require_health(service)
        report(sampler, kills, clients)
        if options.json is not None:
            options.json.write_text(
                json.dumps({"samples": [asdict(one) for one in sampler.samples], "disk_mb": sampler.disk_mb})
            )
        if failures:
            raise SystemExit(f"FAILED: {failures}")


def report(sampler: Sampler, kills: int, clients: Sequence[Client]) -> None:
    """Print what was measured."""
    lives, rankings = sum(client.lives for client in clients), sum(client.rankings for client in clients)
    print(f"{lives} lives of scenes, {rankings} rankings, {kills} kills")
    for warm_s in WARM_S:
        print(f"processes older than {warm_s:.0f} s:")
        _report_slopes([one for one in sampler.samples if one.age_s >= warm_s])
    sizes = [size for _, size in sampler.disk_mb]
    half = len(sizes) // 2
    print(
        f"disk: at most {max(sizes[:half]):.1f} MB in the first half, {max(sizes[half:]):.1f} MB in the other"
    )


def _report_slopes(samples: Sequence[Sample]) -> None:
    print(f"{'process':<12}{'memory MB':>10}{'per hour':>18}{'files':>8}{'per hour':>16}{'processes':>11}")
    for process in sorted({sample.process for sample in samples}):
        own = [one for one in samples if one.process == process]
        if len(own) < 3:
            continue
        memory = slope({(one.pid, one.at_s): one.memory_mb for one in own})
        files = slope({(one.pid, one.at_s): float(one.files) for one in own})
        print(
            f"{process:<12}{memory.mean:>10.1f}{memory.per_hour:>+10.1f} ± {memory.error:<5.1f}"
            f"{files.mean:>8.1f}{files.per_hour:>+9.1f} ± {files.error:<4.1f}{memory.processes:>11}"
        )


def slope(values: Mapping[tuple[int, float], float]) -> Slope:
    """The common slope of several series, (series, seconds) → value, each with a level of its own."""
    series: dict[int, list[tuple[float, float]]] = defaultdict(list)
    for (name, at_s), value in values.items():
        series[name].append((at_s / 3600, value))
    centred: list[list[tuple[float, float]]] = []
    for points in series.values():
        x, y = (sum(column) / len(points) for column in zip(*points, strict=True))
        centred.append([(at - x, value - y) for at, value in points])
    spread = sum(x * x for points in centred for x, _ in points)
    if spread == 0:
        return Slope(sum(values.values()) / len(values), 0.0, math.inf, len(series))
    rate = sum(x * y for points in centred for x, y in points) / spread
    by_series = [sum(x * (y - rate * x) for x, y in points) for points in centred]
    residuals = sum((y - rate * x) ** 2 for points in centred for x, y in points)
    alone = math.sqrt(residuals / max(1, len(values) - len(series) - 1) / spread)
    alike = math.sqrt(sum(one * one for one in by_series)) / spread
    return Slope(sum(values.values()) / len(values), rate, max(alone, alike), len(series))


def _kill(watch: Watch, rng: random.Random, spared: Collection[str]) -> str | None:
    """Kill one process of a random kind that is not ``spared``; returns the kind."""
    processes = {kind: pids for kind, pids in watch.moment().processes.items() if kind not in spared}
    if not processes:
        return None
    process = rng.choice(sorted(processes))
    with contextlib.suppress(ProcessLookupError):
        os.kill(rng.choice(processes[process]), signal.SIGKILL)
        print(f"killed a {process}", flush=True)
        return process
    return None


def _memory_mb(pid: int) -> float:
    """The anonymous memory of a process."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    sizes = [int(line.split()[1]) for line in lines if line.startswith("RssAnon")]
    if not sizes:
        raise ProcessLookupError(pid)  # it has just ended
    return sizes[0] / 1000


def _size_mb(folder: Path) -> float:
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                total += Path(parent, name).lstat().st_blocks * 512
    return total / 1e6


if __name__ == "__main__":
    main()
