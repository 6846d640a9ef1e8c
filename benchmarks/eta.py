"""Error of the estimated remaining time of jobs.

    python benchmarks/eta.py run DATA/kermit/images DATA/lund/images … [--images 12] [--record eta.json]
    python benchmarks/eta.py report eta.json…
    python benchmarks/eta.py replay eta.json…

`run`: `fvs serve`, and for one scene after the other an update with three quarters of the images, one with
all, and a fine model; small ones, so that each takes a minute or two. Every estimate of their events is
recorded; a scene of which a job fails is left at that.

`report`: for every job, and for all, the median of |estimate - time left| / time left over the estimates
after the first tenth of the job (goal 30 %), weighted by the time that each was shown; and how far the
predicted end jumps from one estimate to the next, as a share of the job.

`replay`: the same of the estimates that the service's present code would have made of the recorded progress.
"""

import argparse
import json
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from fvs_client import Client, EventKind, Job, Scene
from fvs_client.errors import JobFailedError
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.worker.progress import JobProgress
from fvs_service.jobs.stages import JobSize, stage_of_job
from fvs_service.jobs.timing import JobTiming
from fvs_service.serving.running import running_service
from measurement import report
from PIL import Image

from fvs_engine.images.pixels import reduced_size
from fvs_schema.jobs import JobKind
from fvs_schema.stages import Stage

_PER_IMAGE = 25
_SMALL = {"FVS_WORKER__ITERATIONS_PER_IMAGE": str(_PER_IMAGE)}
_REPORT_EVERY_S = 2.0
_FROM = 0.1
_LEAST_LEFT_S = 1.0


@dataclass(frozen=True)
class Estimate:
    """The estimate of a progress event, ``at_s`` after the start of the job."""

    at_s: float
    stage: Stage
    progress: float
    eta_s: float | None


@dataclass(frozen=True)
class Recording:
    """A job and its estimates."""

    scene: str
    job: str
    size: dict[str, Any]
    took_s: float
    estimates: tuple[Estimate, ...]

    @property
    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Relative errors after the first tenth, [N], and how long each was shown in s, [N]."""
        shown = [one for one in self.estimates if one.at_s >= _FROM * self.took_s]
        ends = [one.at_s for one in shown[1:]] + [self.took_s]
        errors, weights = [], []
        for one, until_s in zip(shown, ends, strict=True):
            left_s = self.took_s - one.at_s
            if left_s < _LEAST_LEFT_S:
                continue
            errors.append(1.0 if one.eta_s is None else abs(one.eta_s - left_s) / left_s)
            weights.append(until_s - one.at_s)
        return np.asarray(errors), np.asarray(weights)

    @property
    def jump(self) -> float:
        """The largest jump of the predicted end between two estimates, as a share of the job's time."""
        known = [one for one in self.estimates if one.eta_s is not None and one.at_s >= _FROM * self.took_s]
        ends = [one.at_s + one.eta_s for one in known if one.eta_s is not None]
        return float(np.abs(np.diff(ends)).max(initial=0.0)) / self.took_s


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value below which half of the weight is; NaN without any."""
    if not len(values):
        return float("nan")
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())])


class Recorder:
    """Follows a scene's events in a thread."""

    def __init__(self, scene: Scene) -> None:
        self._ended = threading.Condition()
        self._over: set[str] = set()
        self._reported: dict[str, list[Any]] = {}
        self._events = scene.events(after=None)
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def record(self, scene: str, name: str, size: JobSize, job: Job) -> Recording:
        """Wait for the job, and return the estimates of its events."""
        with self._ended:
            self._ended.wait_for(lambda: job.id in self._over)
        data = job.wait()
        assert data.started_at is not None
        assert data.finished_at is not None
        return Recording(
            scene,
            name,
            size.model_dump(),
            (data.finished_at - data.started_at).total_seconds(),
            tuple(
                Estimate(
                    (event.created_at - data.started_at).total_seconds(),
                    Stage(event.data["stage"]),
                    event.data["progress"],
                    event.data["eta_s"],
                )
                for event in self._reported[job.id]
            ),
        )

    def end(self) -> None:
        """Wait for the end of the events of a scene that was deleted."""
        self._thread.join()

    def _follow(self) -> None:
        for event in self._events:
            job_id = event.data.get("job_id", "")
            if event.kind is EventKind.JOB_PROGRESS:
                self._reported.setdefault(job_id, []).append(event)
            elif event.kind in (EventKind.JOB_SUCCEEDED, EventKind.JOB_FAILED, EventKind.JOB_CANCELED):
                with self._ended:
                    self._over.add(job_id)
                    self._ended.notify_all()


def run(options: argparse.Namespace, folder: Path) -> list[Recording]:
    """Run and record the jobs of all scenes."""
    recordings: list[Recording] = []
    with (
        running_service(folder / "service", folder / "service.log", _SMALL) as service,
        Client(service.url) as client,
    ):
        for source in options.folders:
            name = source.parent.name if source.name == "images" else source.name
            files = reduced(source, folder / name, options)
            try:
                recordings.extend(jobs_of(client.scenes.create(name), files, options))
            except JobFailedError as error:
                print(f"{name}: {error}")
            options.record.write_text(json.dumps([asdict(one) for one in recordings]))
    return recordings


def jobs_of(scene: Scene, files: list[Path], options: argparse.Namespace) -> Iterator[Recording]:
    """Run and record the jobs of one scene."""
    recorder, first = Recorder(scene), len(files) - len(files) // 4
    size = size_of(files, first, options)
    scene.images.upload(files[:first])
    update = scene.update(iterations=options.iterations, long_side_px=options.long_side)
    yield recorder.record(scene.name, "update", size, update)
    new = {"new": len(files) - first, "iterations": _PER_IMAGE * (len(files) - first)}
    size = size.model_copy(update={"first": False, "images": len(files), **new})
    scene.images.upload(files[first:])
    yield recorder.record(scene.name, "update 2", size, scene.update())
    size = size.model_copy(update={"new": len(files), "iterations": options.fine_iterations})
    fine = scene.fine(iterations=options.fine_iterations, long_side_px=options.long_side)
    yield recorder.record(scene.name, "fine", size, fine)
    scene.delete()
    recorder.end()


def reduced(source: Path, folder: Path, options: argparse.Namespace) -> list[Path]:
    """The first photographs of a folder, reduced to ``options.reduce`` pixels."""
    folder.mkdir()
    files = sorted(file for file in source.iterdir() if file.suffix.lower() in (".jpg", ".jpeg", ".png"))
    for file in files[: options.images]:
        with Image.open(file) as image:
            image.thumbnail((options.reduce, options.reduce))
            image.convert("RGB").save(folder / f"{file.stem}.jpg", quality=92)
    return sorted(folder.iterdir())


def size_of(files: list[Path], images: int, options: argparse.Namespace) -> JobSize:
    """The size of a scene's first update."""
    with Image.open(files[0]) as image:
        width, height = image.size
    small = reduced_size(width, height, options.long_side)
    return JobSize(
        first=True,
        images=images,
        new=images,
        megapixels=width * height / 1e6,
        train_megapixels=small[0] * small[1] / 1e6,
        iterations=options.iterations,
    )


class ReplayedClock:
    """A clock that tests set."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def replayed(recordings: list[Recording]) -> list[Recording]:
    """The recordings with the estimates of the present code, each from those before it."""
    past: dict[tuple[JobKind, bool], list[JobTiming]] = {}
    found = []
    for one in recordings:
        kind = JobKind.FINE if one.job == "fine" else JobKind.UPDATE
        size, clock = JobSize.model_validate(one.size), ReplayedClock()
        known = past.setdefault((kind, size.first), [])
        remaining = JobProgress(kind, size, known[::-1], clock=clock)
        estimates = []
        for estimate in one.estimates:
            while clock.now_s + _REPORT_EVERY_S < estimate.at_s and estimates:
                clock.now_s += _REPORT_EVERY_S
                estimates.append(replace(estimates[-1], at_s=clock.now_s, eta_s=remaining.now()))
            clock.now_s = estimate.at_s
            stage = StageProgress(stage=estimate.stage, share=share_of(kind, estimate))
            estimates.append(replace(estimate, eta_s=remaining.add(stage)))
        clock.now_s = one.took_s
        timing = remaining.finished()
        assert timing is not None
        known.append(timing)
        found.append(replace(one, estimates=tuple(estimates)))
    return found


def share_of(kind: JobKind, estimate: Estimate) -> float | None:
    """How far a stage had come, from the progress of the job."""
    begin, end = stage_of_job(estimate.stage).part_of(kind)
    return None if begin == end else min(1.0, max(0.0, (estimate.progress - begin) / (end - begin)))


def read(path: Path) -> list[Recording]:
    """Recordings of a file."""
    return [
        Recording(**{**one, "estimates": tuple(Estimate(**row) for row in one["estimates"])})
        for one in json.loads(path.read_text())
    ]


def row(name: str, recordings: list[Recording]) -> dict[str, Any]:
    """The errors of some recordings together."""
    errors, weights = (
        np.concatenate(columns) for columns in zip(*(one.errors for one in recordings), strict=True)
    )
    return {
        "jobs": name,
        "took, s": ", ".join(f"{one.took_s:.0f}" for one in recordings),
        "median error, %": 100 * weighted_median(errors, weights),
        "error at most 30 %, % of the time": 100 * float(weights[errors <= 0.3].sum() / weights.sum()),
        "largest jump, % of the job": 100 * max(one.jump for one in recordings),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=("run", "report", "replay"))
    parser.add_argument("folders", nargs="+", type=Path, help="of photographs; or recordings to report")
    parser.add_argument("--images", type=int, default=12)
    parser.add_argument("--reduce", type=int, default=640, metavar="PX", help="the photographs' long side")
    parser.add_argument("--iterations", type=int, default=300)
    parser.add_argument("--fine-iterations", type=int, default=600)
    parser.add_argument("--long-side", type=int, default=240)
    parser.add_argument("--record", type=Path, default=Path("eta.json"))
    options = parser.parse_args()

    if options.command == "run":
        with tempfile.TemporaryDirectory(prefix="fvs-benchmark-") as name:
            recordings = run(options, Path(name))
    else:
        recordings = [one for path in options.folders for one in read(path)]
        if options.command == "replay":
            recordings = replayed(recordings)
    rows = [row(f"{one.scene}: {one.job}", [one]) for one in recordings]
    rows += [
        row(f"all: {job}", [one for one in recordings if one.job == job])
        for job in dict.fromkeys(one.job for one in recordings)
    ]
    report("estimated times of jobs", [*rows, row("all", recordings)])


if __name__ == "__main__":
    main()
