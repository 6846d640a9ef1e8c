"""Time from photographs on disk to the first ranking through the client, by stage.

    python benchmarks/service_first_ranking.py PHOTOGRAPHS [--candidates 24] [--json first_ranking.json]

`fvs serve` with its defaults, and no scene yet: it is started before the clock is. The stages of the update
are those that the job reports to the client; what happens before it runs (a worker takes it up and
starts the scene's runner) and after its last stage (the client hears of the end) is waiting.
"""

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from fvs_client import Client, Job, Orbit
from fvs_service.serving.running import running_service
from measurement import report

_PARTS = {
    "images": "photographs to the worker",
    "normalise": "photographs to the worker",
    "load": "photographs to the trainer",
    "train": "training",
    "snapshot": "snapshot",
}
"""Stages of a job by what they are for; all others are structure from motion."""


class Stopwatch:
    """Adds up the time that passes in each part."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._part, self._since = "", time.perf_counter()

    def enter(self, part: str) -> None:
        """The part before has ended."""
        now = time.perf_counter()
        if self._part:
            self.seconds[self._part] += now - self._since
        self._part, self._since = part, now

    def follow(self, job: Job) -> None:
        """The part that a job is in."""
        if job.ended:
            self.enter("waiting: for the news of its end")
        elif job.stage is not None:
            self.enter(_PARTS.get(job.stage, f"structure from motion: {job.stage}"))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photographs", type=Path, help="a folder")
    parser.add_argument("--candidates", type=int, default=24)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    watch = Stopwatch()
    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        with (
            running_service(folder / "service", folder / "service.log") as service,
            Client(service.url) as client,
        ):
            watch.enter("upload")
            scene = client.scenes.create("benchmark")
            sent = scene.images.upload(options.photographs)
            watch.enter("waiting: for the worker and its runner")
            job = scene.update().wait(on_progress=watch.follow)
            watch.enter("ranking")
            ranking = scene.rank(generator=Orbit(count=options.candidates))
            watch.enter("")
            snapshot = job.snapshot()
    assert snapshot is not None
    total = sum(watch.seconds.values())
    rows: list[dict[str, Any]] = [
        {"part": part, "s": seconds, "%": 100 * seconds / total} for part, seconds in watch.seconds.items()
    ]
    rows += [
        {"part": "of the ranking: scoring", "s": ranking.seconds, "%": 100 * ranking.seconds / total},
        {"part": "from photographs to ranking", "s": total, "%": 100.0},
    ]
    made = snapshot.metrics
    report(
        f"{len(sent.sent)} photographs ({sent.bytes_sent / 1e6:.0f} MB), {made.registered} registered, "
        f"{made.iterations:,} iterations, {made.gaussians:,} Gaussians, {ranking.total} candidates",
        rows,
        options.json,
    )


if __name__ == "__main__":
    main()
