"""Scenes per hour with one worker and with several, and what each scene costs.

    python benchmarks/service_throughput.py [PHOTOGRAPHS] [--scenes 8] [--images 10] [--workers 1 2]
                                            [--json out.json]

`fvs serve`; every scene has the same photographs: those of a simulated courtyard, with a model of 160 px, or
given ones, with the service's defaults. All photographs are uploaded first; then all updates are queued at
once. The time is that from the first update's request to the last one's end. Costs are means per scene:
seconds of its stages by the clock, seconds of all processes, bytes uploaded and kept, and, with PostgreSQL
(FVS_DATABASE_URL), committed transactions, those of the idle processes included. docs/operate/scaling.md
rests on them.
"""

import argparse
import itertools
import json
import os
import sqlite3
import tempfile
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from statistics import mean
from typing import Any

import psycopg
from fvs_client import Client, JobState
from fvs_service.jobs.timing import TIMING, JobTiming
from fvs_service.serving.running import running_service
from measurement import report
from processor_time import of_tree_s

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

_SMALL_MODEL = {"FVS_WORKER__INITIAL_ITERATIONS": "300", "FVS_WORKER__LONG_SIDE_PX": "160"}
_TRAINING = "training"
_PATIENCE_S = 3600.0
_TIMINGS = f"SELECT document FROM job_milestones WHERE name = '{TIMING}' ORDER BY job_id"
_COMMITS = "SELECT xact_commit FROM pg_stat_database WHERE datname = current_database()"


def commits(url: str | None) -> int:
    """Transactions that PostgreSQL has committed; 0 with SQLite."""
    if url is None:
        return 0
    with psycopg.connect(url) as database:
        found = database.execute(_COMMITS).fetchone()
    assert found is not None
    return int(found[0])


def timings(root: Path, url: str | None) -> list[JobTiming]:
    """The seconds of the stages of all finished jobs."""
    if url is None:
        with closing(sqlite3.connect(root / "fvs.sqlite3")) as database:
            rows = database.execute(_TIMINGS).fetchall()
    else:
        with psycopg.connect(url) as server:
            rows = server.execute(_TIMINGS).fetchall()
    return [
        JobTiming.model_validate(json.loads(document) if isinstance(document, str) else document)
        for (document,) in rows
    ]


def size_bytes(folder: Path) -> int:
    """Bytes of all files below a folder; those with several names count once."""
    return sum({entry.stat().st_ino: entry.stat().st_size for entry in folder.rglob("*")}.values())


def throughput_row(
    photographs: Path, folder: Path, workers: int, scenes: int, settings: Mapping[str, str]
) -> dict[str, Any]:
    """The row of one number of workers."""
    url, root = os.environ.get("FVS_DATABASE_URL"), folder / "root"
    settings = {**settings, "FVS_WORKER__COUNT": str(workers)}
    with running_service(root, folder / "log", settings) as service, Client(service.url) as client:
        made = [client.scenes.create("courtyard") for _ in range(scenes)]
        for scene in made:
            scene.images.upload(photographs)
        upload_cpu_s = of_tree_s(service.pid)
        committed, began = commits(url), time.monotonic()
        jobs = [scene.update() for scene in made]
        ended = [job.wait(timeout_s=_PATIENCE_S) for job in jobs]
        took_s = time.monotonic() - began
        committed = commits(url) - committed
        update_cpu_s = of_tree_s(service.pid) - upload_cpu_s
    failed = sum(job.state is not JobState.SUCCEEDED for job in ended)
    found = timings(root, url)[-scenes:]
    return {
        "workers": workers,
        "scenes": scenes,
        "failed": failed,
        "s": took_s,
        "scenes/h": 3600 * scenes / took_s,
        "training, s": mean(timing.seconds[_TRAINING] for timing in found),
        "before it, s": mean(sum(_before_training(timing).values()) for timing in found),
        "upload, processor s": upload_cpu_s / scenes,
        "update, processor s": update_cpu_s / scenes,
        "uploaded, MB": size_bytes(photographs) / 1e6,
        "kept, MB": size_bytes(root) / 1e6 / scenes,
        **({"transactions": committed / scenes} if url else {}),
    }


def _before_training(timing: JobTiming) -> Mapping[str, float]:
    """The stages of structure from motion: all before training, which come in their order."""
    return dict(itertools.takewhile(lambda stage: stage[0] != _TRAINING, timing.seconds.items()))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photographs", nargs="?", type=Path, help="a folder")
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--images", type=int, default=10)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder, rows = Path(name), []
        photographs, settings = options.photographs, {}
        if photographs is None:
            photographs, settings = folder / "courtyard" / "images", _SMALL_MODEL
            path = orbit(options.images, turns=0.04 * options.images)
            camera = SimulatedCamera.like_a_drone(320, 240)
            write_photographs(folder / "courtyard", courtyard(), camera, path, Monitor())
        for workers in options.workers:
            place = folder / str(workers)
            place.mkdir()
            rows.append(throughput_row(photographs, place, workers, options.scenes, settings))
    report("scenes per hour", rows, options.json)


if __name__ == "__main__":
    main()
