"""Time from photographs on disk to the next ranking through the client, by stage, and to the full model.

    python benchmarks/service_latency.py PHOTOGRAPHS [--first 49] [--more 1] [--candidates 24] [--json FILE]

`fvs serve` with its defaults, and no scene yet: it is started before the clock is. The first photographs
(sorted names are the capture order) make the first model; then more come, one at a time. Each time they are
uploaded, and an update runs; the next ranking is asked for as soon as the quick model is there, while the
full one is trained, and one more as soon as many first photographs have a model of the first ten of them. The
stages of an update are those that the job reports to the client; what happens before it runs (a worker takes
it up and starts the scene's runner) and after its last stage (the client hears of the end) is waiting.

For each part its time by the clock, and the processor time of all processes of the service and of the client,
which other load hardly changes. Goals in processor time, with `fox`: 90 s for the first model, 6 s from one
more photograph to the next ranking.
"""

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fvs_client import Client, Job, Orbit, Scene
from fvs_service.serving.running import RunningService, running_service
from measurement import report
from processor_time import of_tree_s

_PARTS = {
    "images": "photographs to the worker",
    "normalise": "photographs to the worker",
    "load": "photographs to the trainer",
    "evaluate": "rendering the new views",
    "first-model": "model of the first images",
    "quick-training": "quick model",
    "quick-snapshot": "quick model",
    "training": "full model",
    "snapshot": "full model",
}
"""Stages of a job by what they are for; all others are structure from motion."""
_RANKING = "ranking, while the full model trains"
_FIRST_RANKING = "ranking, by the first images"
_FIRST_MODEL = "first-model"


class Stopwatch:
    """Sums wall-clock and processor time by part."""

    def __init__(self, service: RunningService, rank: Callable[[], object]) -> None:
        self.seconds: Counter[str] = Counter()
        self.processor_s: Counter[str] = Counter()
        self._service, self._rank = service, rank
        self._part, self._since = "", self._now()

    def enter(self, part: str) -> None:
        """The part before has ended."""
        now, now_s = self._now()
        since, since_s = self._since
        if self._part:
            self.seconds[self._part] += now - since
            self.processor_s[self._part] += now_s - since_s
        self._part, self._since = part, (now, now_s)

    def follow(self, job: Job) -> None:
        """The part that a job is in."""
        if job.ended:
            self.enter("waiting: for the news of its end")
        elif job.stage is not None:
            if self._part == _PARTS[_FIRST_MODEL] and job.stage != _FIRST_MODEL:
                self.enter(_FIRST_RANKING)
                self._rank()
            if job.stage == "training" and _RANKING not in self.seconds:
                self.enter(_RANKING)
                self._rank()
            self.enter(_PARTS.get(job.stage, f"structure from motion: {job.stage}"))

    def _now(self) -> tuple[float, float]:
        return time.perf_counter(), time.process_time() + of_tree_s(self._service.pid)


def measure_update(
    service: RunningService, scene: Scene, photographs: Sequence[Path], candidates: int
) -> Stopwatch:
    """The times from photographs to the ranking by a model with them, and to the full model."""
    watch = Stopwatch(service, lambda: scene.rank(generator=Orbit(count=candidates)))
    watch.enter("upload")
    scene.images.upload(photographs)
    watch.enter("waiting: for the worker and its runner")
    scene.update().wait(on_progress=watch.follow)
    watch.enter("")
    return watch


def rows_of(case: str, watch: Stopwatch) -> list[dict[str, Any]]:
    """The parts of one update, and what has passed since the photographs at the end of each."""
    rows, passed, used = [], 0.0, 0.0
    for part, seconds in watch.seconds.items():
        processor_s = watch.processor_s[part]
        passed, used = passed + seconds, used + processor_s
        rows.append(
            {
                "photographs": case,
                "part": part,
                "s": seconds,
                "processor s": processor_s,
                "in all, s": passed,
                "in all, processor s": used,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photographs", type=Path, help="a folder")
    parser.add_argument("--first", type=int, default=49, help="photographs of the first model")
    parser.add_argument("--more", type=int, default=1, help="photographs that come one at a time")
    parser.add_argument("--candidates", type=int, default=24)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    photographs = sorted(path for path in options.photographs.iterdir() if path.is_file())
    if len(photographs) < options.first + options.more:
        parser.error(f"{options.photographs} has {len(photographs)} photographs; choose --first and --more")
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
        folder = Path(name)
        with (
            running_service(folder / "service", folder / "service.log") as service,
            Client(service.url) as client,
        ):
            scene = client.scenes.create("benchmark")
            first = measure_update(service, scene, photographs[: options.first], options.candidates)
            rows += rows_of(f"the first {options.first}", first)
            for number in range(options.first, options.first + options.more):
                one = measure_update(service, scene, [photographs[number]], options.candidates)
                rows += rows_of(f"number {number + 1}", one)
            metrics = client.snapshots.get(scene.refresh().snapshot_id).metrics
    report(
        f"{options.first} + {options.more} photographs, {metrics.registered} registered; "
        f"{metrics.iterations:,} iterations, {metrics.gaussians:,} Gaussians",
        rows,
        options.json,
    )


if __name__ == "__main__":
    main()
