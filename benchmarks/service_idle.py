"""What an idle service costs, and how soon it wakes up.

    python benchmarks/service_idle.py [--quiet 120] [--jobs 20] [--streams 1] [--json idle.json]

`fvs serve` with its defaults (and those of the environment: FVS_DATABASE_URL measures another database), a
small model of a simulated courtyard, and its runner, which stays loaded.

* Processor time of every process over quiet seconds, without a client and with open streams of events. Goal:
  all together ≤ 0.5 % of a core.
* Jobs, each at a random moment of the quiet service: the time from the job's commit to its start (goal
  0.3 s), and from the commits of its first two events to their arrival over a stream.
"""

import argparse
import random
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from fvs_client import Client, Event, EventKind, Scene
from fvs_service.serving.process_tree import command_of, descendants
from fvs_service.serving.running import GATEWAY, RUNNER, WORKER, RunningService, running_service
from measurement import report
from processor_time import own_s

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

_SETTLE_S = 15.0
_ROLES = {GATEWAY: "gateway", WORKER: "worker", RUNNER: "runner", "multiprocessing": "inspectors"}


def role_of(pid: int, service: RunningService) -> str:
    """The role of a process of the service."""
    if pid == service.pid:
        return "supervisor"
    command = command_of(pid)
    return next((role for part, role in _ROLES.items() if part in command), command)


def used_s(service: RunningService) -> dict[str, float]:
    """The processor time of the service's processes by role."""
    total: dict[str, float] = {}
    for pid in (service.pid, *descendants(service.pid)):
        role = role_of(pid, service)
        total[role] = total.get(role, 0.0) + own_s(pid)
    return total


def quiet_row(service: RunningService, quiet_s: float, streams: int) -> Mapping[str, Any]:
    """Processor time over quiet seconds, in percent of a core."""
    time.sleep(_SETTLE_S)
    before, began = used_s(service), time.monotonic()
    time.sleep(quiet_s)
    after, took_s = used_s(service), time.monotonic() - began
    percent = {role: 100 * (after[role] - before.get(role, 0.0)) / took_s for role in after}
    return {
        "what": f"% of a core over {took_s:.0f} s, {streams} streams",
        **percent,
        "all": sum(percent.values()),
    }


class Watched:
    """Follows a scene's events in a thread, and notes when each arrived."""

    def __init__(self, scene: Scene) -> None:
        self.arrived: list[tuple[Event, datetime]] = []
        self._changed = threading.Condition()
        self._events = scene.events(after=None)
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def of(self, job_id: str, kind: EventKind) -> tuple[Event, datetime]:
        """An event of a job, once it has arrived, and when that was."""
        with self._changed:
            return self._changed.wait_for(lambda: next(self._matching(job_id, kind), None))

    def end(self) -> None:
        """Wait for the end of the events of a scene that was deleted."""
        self._thread.join()

    def _matching(self, job_id: str, kind: EventKind) -> Iterator[tuple[Event, datetime]]:
        return (one for one in self.arrived if one[0].kind is kind and one[0].data["job_id"] == job_id)

    def _follow(self) -> None:
        for event in self._events:
            with self._changed:
                self.arrived.append((event, datetime.now(UTC)))
                self._changed.notify_all()


def delays_row(scene: Scene, jobs: int) -> Mapping[str, Any]:
    """Delays from a job's commit to its start, and to the arrival of its event; deletes the scene."""
    watched = Watched(scene)
    starts, events = [], []
    for _ in range(jobs):
        time.sleep(1.0 + random.random())
        job = scene.update()
        queued, queued_arrived = watched.of(job.id, EventKind.JOB_QUEUED)
        started, started_arrived = watched.of(job.id, EventKind.JOB_STARTED)
        starts.append((started.created_at - queued.created_at).total_seconds())
        for event, arrived in ((queued, queued_arrived), (started, started_arrived)):
            events.append((arrived - event.created_at).total_seconds())
        job.wait()
    scene.delete()
    watched.end()
    return {"jobs": jobs, **_spread("start of a job, s", starts), **_spread("arrival of an event, s", events)}


def _spread(name: str, seconds: list[float]) -> dict[str, str]:
    low, middle, high = np.percentile(seconds, [50, 95, 100])
    return {f"{name}: p50 / p95 / max": f"{low:.3f} / {middle:.3f} / {high:.3f}"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quiet", type=float, default=120.0, metavar="S")
    parser.add_argument("--jobs", type=int, default=20)
    parser.add_argument("--streams", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        camera = SimulatedCamera.like_a_drone(320, 240)
        write_photographs(folder / "courtyard", courtyard(), camera, orbit(6, turns=0.24), Monitor())
        with (
            running_service(folder / "service", folder / "service.log") as service,
            Client(service.url) as client,
        ):
            scene = client.scenes.create("benchmark")
            scene.images.upload(folder / "courtyard" / "images")
            scene.update(iterations=50, long_side_px=160).wait()
            rows = [quiet_row(service, options.quiet, 0)]
            streams = [Watched(scene) for _ in range(options.streams)]
            rows.append(quiet_row(service, options.quiet, len(streams)))
            delays = delays_row(scene, options.jobs)
    report("an idle service", rows, options.json)
    report("the delays of a quiet service", [delays])


if __name__ == "__main__":
    main()
