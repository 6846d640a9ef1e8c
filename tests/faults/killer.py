"""Choose what to kill and when: at every stage of a job, every kind of process that exists at that stage."""

import contextlib
import os
import random
import signal
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

TARGETS = {
    "gateway": "fvs_service.serving.process gateway",
    "worker": "fvs_service.serving.process worker",
    "runner": "fvs_service.host.runner.process",
    "sfm": "fvs_engine.sfm.native.child",
}
BETWEEN_JOBS, REMOVING = "uploading", "removing"
_REMOVALS = "SELECT count(*) FROM removals WHERE removed_at IS NULL"

_POLL_S = 0.02
_LONGEST_S = 3.0
"""The kill falls within so much of an aim's time, however long that is."""
_MOST_PER_JOB = 4
"""Deaths that one job meets at most: six without any progress between them are its end, by design."""


class Aim(NamedTuple):
    """A kind of process at a stage, such as ``sfm`` at ``update: matching``."""

    target: str
    stage: str


@dataclass(frozen=True)
class Moment:
    """The state of a service: the running job, its stage, and the processes that exist."""

    job: str | None
    stage: str
    processes: dict[str, list[int]]

    @property
    def aims(self) -> list[Aim]:
        """The targets that can be killed now."""
        return [Aim(target, self.stage) for target in self.processes]


class Watch:
    """Observes a service from outside: its processes, and the jobs in its database."""

    def __init__(self, supervisor: int, database: Path) -> None:
        self._supervisor = supervisor
        self._database = database
        self._born: dict[int, str] = {}

    def moment(self) -> Moment:
        """The present state."""
        query = "SELECT id, kind, stage FROM jobs WHERE state IN ('queued', 'running')"
        with contextlib.closing(sqlite3.connect(self._database, timeout=30)) as database:
            row = database.execute(query).fetchone()
            (removals,) = database.execute(_REMOVALS).fetchone()
        if row is None:
            return Moment(None, REMOVING if removals else BETWEEN_JOBS, self._targets())
        job, kind, stage = row
        return Moment(job, f"{kind}: {stage or 'queued'}", self._targets())

    def orphans(self) -> list[int]:
        """Processes of the service that survived their parents, and are not the supervisor's either."""
        processes = list(_processes())
        parents = {pid: parent for pid, parent, _ in processes}
        births = {pid: born for pid, _, born in processes}
        return [
            pid
            for pid, born in self._born.items()
            if births.get(pid) == born and not self._is_below(pid, parents)
        ]

    def describe(self, pids: Sequence[int]) -> str:
        """The commands of processes."""
        return "; ".join(f"{pid}: {_command(pid)}" for pid in pids)

    def _targets(self) -> dict[str, list[int]]:
        """The service's processes by target."""
        processes = list(_processes())
        parents = {pid: parent for pid, parent, _ in processes}
        found: dict[str, list[int]] = {}
        for pid, _, born in processes:
            if not self._is_below(pid, parents):
                continue
            for target, module in TARGETS.items():
                if module in _command(pid):
                    found.setdefault(target, []).append(pid)
                    self._born[pid] = born
        # Of workers those with a runner come first: they are the ones whose death matters.
        busy = {parents[runner] for runner in found.get("runner", ())}
        found.get("worker", []).sort(key=lambda pid: pid not in busy)
        return found

    def _is_below(self, pid: int, parents: dict[int, int]) -> bool:
        while pid in parents and parents[pid] != self._supervisor:
            pid = parents[pid]
        return pid in parents


class Killer(threading.Thread):
    """Records which processes exist at which stage and for how long; kills once it has targets.

    Each aim is struck once, at a random moment of its usual time.
    """

    def __init__(self, watch: Watch, rng: random.Random) -> None:
        super().__init__(daemon=True)
        self._watch = watch
        self._rng = rng
        self._usual_s: Counter[Aim] = Counter()
        self._left: Counter[Aim] = Counter()
        self._missed: Counter[Aim] = Counter()
        self._deaths: Counter[str | None] = Counter()
        self._end = threading.Event()
        self.seen_s: Counter[Aim] = Counter()
        self.killed: Counter[Aim] = Counter()

    def __enter__(self) -> "Killer":
        self.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._end.set()
        self.join()

    @property
    def left(self) -> list[Aim]:
        """The kills that are still planned."""
        return list(self._left.elements())

    def aim_at(self, aims: Sequence[Aim]) -> None:
        """Start killing."""
        self._usual_s = Counter(self.seen_s)
        self._left = Counter(aims)

    def run(self) -> None:
        """Observe the service, and kill."""
        looked = time.monotonic()
        while not self._end.wait(_POLL_S):
            moment = self._watch.moment()
            now = time.monotonic()
            for aim in moment.aims:
                self.seen_s[aim] += now - looked
            looked = now
            due = [aim for aim in moment.aims if self._left[aim] > 0 and self._may(aim, moment)]
            if due:
                self._strike(self._rng.choice(due))

    def table(self) -> str:
        """Kills by stage and target; a dash where the target did not exist, or not for long enough."""
        lines = [f"{'stage':<28}" + "".join(f"{target:>9}" for target in TARGETS)]
        for stage in dict.fromkeys(aim.stage for aim in self._usual_s):
            aims = [Aim(target, stage) for target in TARGETS]
            told = [
                str(self.killed[aim]) if self.killed[aim] or _is_long(self._usual_s[aim]) else "-"
                for aim in aims
            ]
            lines.append(f"{stage:<28}" + "".join(f"{number:>9}" for number in told))
        sums = [sum(n for aim, n in self.killed.items() if aim.target == target) for target in TARGETS]
        return "\n".join([*lines, f"{'all':<28}" + "".join(f"{number:>9}" for number in sums)])

    def _may(self, aim: Aim, moment: Moment) -> bool:
        harmless = aim.target == "gateway" or moment.job is None
        return harmless or self._deaths[moment.job] < _MOST_PER_JOB

    def _strike(self, aim: Aim) -> None:
        usual_s = min(_LONGEST_S, self._usual_s[aim])
        time.sleep(self._rng.uniform(0, usual_s / 2 ** self._missed[aim]))
        moment = self._watch.moment()
        if aim not in moment.aims:
            self._missed[aim] += 1
            return
        with contextlib.suppress(ProcessLookupError):
            os.kill(moment.processes[aim.target][0], signal.SIGKILL)
            self._left[aim] -= 1
            self.killed[aim] += 1
            self._deaths[moment.job] += aim.target != "gateway"
            print(f"  kill {self.killed.total():3d}: {aim.target} at {aim.stage}", flush=True)


def choose_aims(seen_s: Counter[Aim], kills: int | None, rng: random.Random) -> list[Aim]:
    """So many of the aims that were seen, or all: each once before any twice, and the targets in turn."""
    by_target: dict[str, list[Aim]] = {target: [] for target in TARGETS}
    for aim, seconds in seen_s.items():
        if _is_long(seconds):
            by_target[aim.target].append(aim)
    kills = kills or sum(map(len, by_target.values()))
    chosen: list[Aim] = []
    while len(chosen) < kills:
        for aims in by_target.values():
            rng.shuffle(aims)
        for turn in range(max(map(len, by_target.values()))):
            chosen += [aims[turn] for aims in by_target.values() if turn < len(aims)]
    return chosen[:kills]


def _is_long(seconds: float) -> bool:
    return seconds >= 2.5 * _POLL_S


def _processes() -> Iterator[tuple[int, int, str]]:
    """Process id, parent and time of birth of everything that runs; zombies do not."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                state, parent, *rest = (folder / "stat").read_text().rsplit(")", 1)[1].split()
                if state != "Z":
                    yield int(folder.name), int(parent), rest[17]


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().replace("\0", " ")
    return ""
