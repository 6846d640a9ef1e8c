"""Speed of scoring in candidates/s, compared with rendering one by one and an FFT in numpy.

    python benchmarks/score.py [--counts 10 100] [--gaussians 100000] [--backend cpu] [--processor-time]
                               [--json score.json]

For every image size: the time of a render and of its score (FFT + median), side by side, and the latter's
share of a scored view (goal: ≤ 30 %). Then candidates/s from 10 to 1,000 candidates (goal: the same for all
counts), and the naive way in the same run. Last, by the clock, alone and beside a process that keeps one core
busy: 24 candidates at once, one thread each, and one after the other, all threads each.
"""

import argparse
import itertools
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from measurement import measure, measure_side_by_side, report
from room import candidates, scene

from fvs_engine.score import MedianFrequency, median_log_magnitude
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView

SIZES = ((480, 270), (960, 540), (1920, 1080))
SMALL = (160, 120)
FEW_GAUSSIANS = 13_000
"""The number of points of a small scene's structure from motion: the score's share is largest with few."""


def score_naively(gaussians: Gaussians, views: list[PinholeView], rasterizer: Rasterizer) -> list[float]:
    """The definition as one would first write it."""
    scores = []
    for view in views:
        with torch.no_grad():
            color = rasterizer.render(gaussians, view.camera, view.camera_from_model).color
        image = color.clamp(0, 1).cpu().numpy()
        scores.append(float(np.median(np.log(np.abs(np.fft.fft2(image, axes=(0, 1)))))))
    return scores


def shares(
    counts: list[int], rasterizer: Rasterizer, repeat: int, clock: Callable[[], float]
) -> list[dict[str, Any]]:
    """Time of the parts of a scored view, per number of Gaussians and image size."""
    rows = []
    for gaussians_count, (width, height) in itertools.product(counts, SIZES):
        gaussians = scene(gaussians_count).to(rasterizer.device)
        (view,) = candidates(1, width, height)

        def render(gaussians: Gaussians = gaussians, view: PinholeView = view) -> torch.Tensor:
            with torch.no_grad():
                return rasterizer.render(gaussians, view.camera, view.camera_from_model).color

        image = render()[None]
        times = measure_side_by_side(
            {
                "render": render,
                "score": lambda image=image: median_log_magnitude(image),  # type: ignore[misc]
                "numpy": lambda image=image: np.median(  # type: ignore[misc]
                    np.log(np.abs(np.fft.fft2(image[0].clamp(0, 1).cpu().numpy(), axes=(0, 1))))
                ),
            },
            repeat,
            clock=clock,
        )
        share = times["score"].median_s / (times["score"].median_s + times["render"].median_s)
        rows.append(
            {
                "Gaussians": gaussians_count,
                "image": f"{width}×{height}",
                "render": times["render"],
                "FFT + median": times["score"],
                "in numpy": times["numpy"],
                "× numpy": times["numpy"].median_s / times["score"].median_s,
                "share of a scored view": share,
            }
        )
    return rows


def rates(
    gaussians: Gaussians,
    rasterizer: Rasterizer,
    counts: list[int],
    repeat: int,
    clock: Callable[[], float],
) -> list[dict[str, Any]]:
    """Candidates/s for every image size and count; the naive way on at most 10 candidates."""
    scorer = MedianFrequency()
    rows = []
    for width, height in SIZES:
        few = candidates(10, width, height)
        naive = measure(
            lambda views=few: score_naively(gaussians, views, rasterizer),  # type: ignore[misc]
            repeat,
            clock=clock,
        )
        for count in counts:
            views = candidates(count, width, height)
            ours = measure(
                lambda views=views: scorer.score(gaussians, views, rasterizer),  # type: ignore[misc]
                repeat=repeat if count <= 100 else 1,  # a thousand are a mean of their own
                warmup=int(count <= 10),
                clock=clock,
            )
            rows.append(
                {
                    "image": f"{width}×{height}",
                    "candidates": count,
                    "time": ours,
                    "candidates/s": count / ours.median_s,
                    "naive candidates/s": len(few) / naive.median_s,
                    "× naive": (count / ours.median_s) / (len(few) / naive.median_s),
                }
            )
    return rows


@contextmanager
def busy_process() -> Iterator[None]:
    """A process of the same priority that keeps one core busy."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def threads(gaussians: Gaussians, rasterizer: Rasterizer, repeat: int) -> list[dict[str, Any]]:
    """The time of 24 candidates by the clock, for two ways to use the threads."""
    scorer = MedianFrequency()
    rows = []
    for width, height in (SMALL, *SIZES):
        views = candidates(24, width, height)

        def one_by_one(views: list[PinholeView] = views) -> None:
            for view in views:
                scorer.score(gaussians, [view], rasterizer)

        ways = {
            "at once": lambda views=views: scorer.score(gaussians, views, rasterizer),
            "in turn": one_by_one,
        }
        alone = measure_side_by_side(ways, repeat)
        with busy_process():
            beside = measure_side_by_side(ways, repeat)
        rows.append(
            {
                "Gaussians": len(gaussians),
                "image": f"{width}×{height}",
                **{
                    f"{way}, {where}": times[way]
                    for where, times in (("alone", alone), ("busy", beside))
                    for way in ways
                },
                "ratio, alone": alone["in turn"].median_s / alone["at once"].median_s,
                "ratio, busy": beside["in turn"].median_s / beside["at once"].median_s,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--gaussians", type=int, default=100_000)
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 100, 1000], help="of candidates")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--processor-time", action="store_true", help="of all threads, for a busy machine")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rasterizer = create_rasterizer(options.backend)
    clock = time.process_time if options.processor_time else time.perf_counter
    named = "processor time" if options.processor_time else "wall time"
    name = f"score, {rasterizer.name} rasteriser, {options.gaussians:,} Gaussians, {named}"

    def show(part: str, rows: list[dict[str, Any]]) -> None:
        path = options.json and options.json.with_stem(f"{options.json.stem}-{part}")
        report(f"{name}: {part}", rows, path)

    few = min(options.gaussians, FEW_GAUSSIANS)
    with on_device(rasterizer.device):
        show("share", shares(sorted({few, options.gaussians}), rasterizer, 2 * options.repeat + 1, clock))
        gaussians = scene(options.gaussians).to(rasterizer.device)
        show("rate", rates(gaussians, rasterizer, options.counts, options.repeat, clock))
        if rasterizer.device.type == "cpu":
            show(
                "threads",
                [
                    row
                    for some in (scene(few), gaussians)
                    for row in threads(some, rasterizer, options.repeat)
                ],
            )


if __name__ == "__main__":
    main()
