"""Time of one step of the loop, compared with the paper's way: everything from scratch after every image.

    python benchmarks/loop.py DATASET [--counts 10 25 50] [--long-side 400] [--candidates 50] [--json
    loop.json]

A step is: a new image registered in the current model (structure from motion on the visited ones only), a
quick model trained and saved, and the 50 nearest candidates rendered and ranked by their median frequency.
The nearest view is always visited next, so that the paper's way works too: where the selector may go to the
worst render, it meets images that overlap too little for structure from motion from scratch. Around every
count n the median of three steps is taken. The paper's way with the same n + 1 images, in the same run and
on the same threads: structure from motion from scratch, the full model, as many candidates ranked (goal: a
step costs ≤ 1/20 of that at 50, and does not grow with the number of views beyond what matching needs).
"""

import argparse
import itertools
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
from measurement import Timing, report
from processor_time import so_far_s

from fvs_engine.geometry.alignment.dataset import align_dataset
from fvs_engine.lab.baselines import create_selector
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.selection_request import SelectionRequest
from fvs_engine.scene.dataset import open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.score import MedianFrequency, rank
from fvs_engine.select.loop import LoopSettings, SelectionLoop, StepRecord
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView

INITIAL = 10
TIMED = 3
"""Steps that are timed around a count."""


@dataclass(frozen=True)
class Step:
    """A turn of the loop, and the processor time that it took on all cores and in all processes."""

    record: StepRecord
    ranking_s: float
    processor_s: float

    @property
    def seconds(self) -> float:
        return self.ranking_s + self.record.seconds.add + self.record.seconds.train


@dataclass(frozen=True)
class Again:
    """Seconds of a reconstruction and a training from scratch, and their result."""

    sfm: float
    train: float
    score: float
    processor_s: float
    registered: int

    @property
    def total(self) -> float:
        return self.sfm + self.train + self.score


def take_step(loop: SelectionLoop, candidates: int) -> Step | None:
    """Visit the next view and rank those near it; None when none is left."""
    worked = so_far_s()
    record = loop.step(Monitor())
    if not isinstance(record, StepRecord):
        print(record.message, flush=True)
        return None
    began = time.perf_counter()
    rank_nearest(loop.model, loop.scene, loop, candidates)
    step = Step(record, time.perf_counter() - began, so_far_s() - worked)
    print(
        f"{record.views} views, {record.registered} registered, {step.seconds:.1f} s: {record.seconds}",
        flush=True,
    )
    return step


def rank_nearest(model: SceneModel, scene: Scene, loop: SelectionLoop, count: int) -> None:
    """Rank the unvisited views, by a model of ``scene``, that are nearest to the last visited one."""
    centres = loop.dataset.centres()
    here = centres[loop.visited[-1]]
    near = sorted(loop.unvisited, key=lambda name: float(np.linalg.norm(centres[name] - here)))[:count]
    rank(MedianFrequency().score(model.gaussians, in_model(near, scene), scene.rasterizer))


def everything_again(loop: SelectionLoop, step: StepRecord, count: int) -> Again:
    """The state after a step, made from scratch, and as many candidates ranked."""
    names = loop.visited[: step.views]
    worked = so_far_s()
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.open(Path(folder), loop.dataset, loop.settings.scene, loop.scene.rasterizer, Monitor())
        times = [time.perf_counter()]
        scene.add(names, Monitor())
        times.append(time.perf_counter())
        model = scene.train("full", Monitor())
        times.append(time.perf_counter())
        rank_nearest(model, scene, loop, count)
        times.append(time.perf_counter())
        sfm, train, score = (after - before for before, after in itertools.pairwise(times))
        return Again(sfm, train, score, so_far_s() - worked, len(scene.views))


def in_model(names: list[str], scene: Scene) -> list[PinholeView]:
    """Views of the dataset as candidates in the frame of the scene's model."""
    worlds = {name: scene.dataset.by_name[name].camera_from_model.inverse() for name in scene.dataset.names}
    alignment = align_dataset(
        [worlds[view.name] for view in scene.views],
        [view.camera_from_model.inverse() for view in scene.views],
    )
    return [
        PinholeView(
            name,
            scene.expected_camera(name),
            alignment.model_from_world.move_camera(worlds[name]).inverse(),
        )
        for name in names
    ]


def compare(loop: SelectionLoop, steps: list[Step], views: int, candidates: int) -> dict[str, Any]:
    """A row of the table: the step that begins with ``views`` views, and everything again."""
    (middle,) = (index for index, step in enumerate(steps) if step.record.views == views + 1)
    around = steps[max(middle - TIMED // 2, 0) : middle + TIMED // 2 + 1]
    parts = [step.record.seconds for step in around]
    totals = [step.seconds for step in around]
    worked = median(step.processor_s for step in around)
    again = everything_again(loop, steps[middle].record, candidates)
    print(f"{views + 1} views from scratch: {again}", flush=True)
    return {
        "views": views,
        "a step": Timing(min(totals), median(totals), max(totals), len(totals)),
        "ranking": median(step.ranking_s for step in around),
        "adding": median(part.add for part in parts),
        "training": median(part.train for part in parts),
        "again, s": again.total,
        "SfM": again.sfm,
        "all training": again.train,
        "registered": f"{steps[middle].record.registered} / {again.registered}",
        "× faster": again.total / median(totals),
        "processor, s": worked,
        "again, processor": again.processor_s,
        "× less": again.processor_s / worked,
        "mean of all steps so far, processor": mean(step.processor_s for step in steps[: middle + 1]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 25, 50])
    parser.add_argument("--long-side", type=int, default=400)
    parser.add_argument("--candidates", type=int, default=50)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--threads", type=int, default=1, help="of structure from motion")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    dataset = open_dataset(options.dataset)
    settings = LoopSettings(
        scene=SelectionRequest(long_side_px=options.long_side, threads=options.threads).scene_settings(),
        initial=INITIAL,
        budget=max(options.counts) + TIMED // 2 + 1,
        method="nearest",
        nearest=1,
    )
    with tempfile.TemporaryDirectory() as folder:
        rasterizer = create_rasterizer(options.backend)
        loop = SelectionLoop.open(
            Path(folder) / "selection", dataset, settings, create_selector("nearest"), rasterizer, Monitor()
        )
        loop.begin(Monitor())
        steps = list(iter(lambda: take_step(loop, options.candidates), None))
        rows = [compare(loop, steps, count, options.candidates) for count in options.counts]
    name = f"loop, {dataset.name}, {options.long_side} px, {rasterizer.name}, {options.threads} SfM thread(s)"
    report(name, rows, options.json)


if __name__ == "__main__":
    main()
