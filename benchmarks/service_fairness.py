"""How long one tenant's small job waits behind the jobs of another.

    python benchmarks/service_fairness.py [--jobs 30] [--iterations 4000] [--workers 1] [--json fairness.json]

`fvs serve` with API keys; every scene is the same simulated courtyard, at 160 px. Two cases:

* tenant A queues `--jobs` updates, each of a scene of its own; then tenant B queues one update;
* tenant A's fine model of `--iterations` iterations has trained for some seconds; then tenant B queues a fine
  model of 100 iterations.

For each: the time until B's job started and until it ended, the number of A's jobs that ended before it, and
the time until all of A's had ended: B would have waited for as long, were jobs first come, first served.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fvs_client import Client, Job, Scene
from fvs_service.serving.running import running_service
from measurement import report

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

_PHOTOGRAPHS = 6
_SETTINGS = {
    "FVS_REQUIRE_KEYS": "1",
    "FVS_WORKER__INITIAL_ITERATIONS": "100",
    "FVS_WORKER__LONG_SIDE_PX": "160",
}
_SMALL_ITERATIONS = 100
_HEAD_START_S = 40.0
_POLL_S = 0.2
_PATIENCE_S = 3600.0


def make_key(root: Path, tenant: str) -> str:
    """A new API key of a tenant."""
    command = [sys.executable, "-c", "from fvs_engine.cli import main; main()", "keys", "create", "benchmark"]
    made = subprocess.run(
        [*command, "--tenant", tenant, "--root", str(root)], check=True, capture_output=True, text=True
    )
    return made.stdout.strip()


def new_scene(client: Client, photographs: Path) -> Scene:
    """A scene with all photographs."""
    scene = client.scenes.create("courtyard")
    scene.images.upload(photographs)
    return scene


def wait_of(case: str, job: Job, others: Sequence[Job]) -> dict[str, Any]:
    """The row of a case: when ``job`` started and ended, and how many of the ``others`` ended before it."""
    queued = time.monotonic()
    started = 0.0
    while job.state not in ("succeeded", "failed", "canceled"):
        assert time.monotonic() - queued < _PATIENCE_S
        time.sleep(_POLL_S)
        job = job.refresh()
        if not started and job.started_at is not None:
            started = time.monotonic() - queued
    took = time.monotonic() - queued
    ended = sum(other.refresh().finished_at is not None for other in others)
    for other in others:
        other.wait()
    return {
        "case": case,
        "B started after, s": started,
        "B ended after, s": took,
        "B's state": str(job.state),
        "A's jobs that ended before": f"{ended} of {len(others)}",
        "A's jobs had all ended after, s": time.monotonic() - queued,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--jobs", type=int, default=30)
    parser.add_argument("--iterations", type=int, default=4000, help="of A's fine model")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        camera = SimulatedCamera.like_a_drone(320, 240)
        write_photographs(
            folder / "courtyard", courtyard(), camera, orbit(_PHOTOGRAPHS, turns=0.24), Monitor()
        )
        photographs = folder / "courtyard" / "images"
        root = folder / "service"
        keys = {tenant: make_key(root, tenant) for tenant in ("a", "b")}
        settings = {**_SETTINGS, "FVS_WORKER__COUNT": str(options.workers)}
        with (
            running_service(root, folder / "service.log", settings) as service,
            Client(service.url, keys["a"]) as a,
            Client(service.url, keys["b"]) as b,
        ):
            trained, own = new_scene(a, photographs), new_scene(b, photographs)
            trained.update().wait()
            scenes = [new_scene(a, photographs) for _ in range(options.jobs)]
            updates = [scene.update() for scene in scenes]
            rows = [wait_of(f"{options.jobs} updates of A, one of B", own.update(), updates)]
            fine = trained.fine(iterations=options.iterations)
            while fine.refresh().stage != "training":
                time.sleep(_POLL_S)
            time.sleep(_HEAD_START_S)
            small = own.fine(iterations=_SMALL_ITERATIONS)
            rows.append(
                wait_of(f"a fine model of A ({options.iterations} iterations), one of B", small, [fine])
            )
    report("fairness between tenants", rows, options.json)


if __name__ == "__main__":
    main()
