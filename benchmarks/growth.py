"""Quality and cost of a scene's models while views are added one by one.

    python benchmarks/growth.py DATASET [--colmap MODEL] [--counts 10 20 40] [--spread far near]
        [--seeds 0 1 2] [--long-side 256] [--max-gaussians 25000] [--json growth.json]

Known poses. Views are added one by one: far-spread ones, each farthest from all before, or near ones, in
order of capture; the quick model is trained after each, the full model at the counts. Every eighth view is
held out. The processor time is that of training since the last row, and of the full model alone (run it with
NUMBA_NUM_THREADS=1 and OMP_NUM_THREADS=1, else waiting threads count, too).
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from measurement import report

from fvs_engine.choices import InitialChoice
from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.select.initial_views import initial_views
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.splat.views import TrainingView

FIRST = 4
SPREADS: dict[str, InitialChoice] = {"far": "farthest", "near": "consecutive"}


def quality_db(model: SceneModel, views: list[TrainingView], rasterizer: Rasterizer) -> float:
    """Mean PSNR over views."""
    renders = (render_color(model.gaussians, view, rasterizer, sh_degree=model.sh_degree) for view in views)
    return float(
        np.mean([psnr(render, view.image / 255) for render, view in zip(renders, views, strict=True)])
    )


def rows(
    dataset: Dataset, spread: str, settings: SceneSettings, counts: list[int], rasterizer: Rasterizer
) -> Iterator[dict[str, Any]]:
    """One row per count."""
    pool, held_out = hold_out(dataset.names, 8)
    views = [dataset.by_name[name] for name in pool]
    names = initial_views(views, max(counts), SPREADS[spread], settings.seed)
    growing_s = 0.0
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.open(Path(folder), dataset, settings, rasterizer, Monitor())
        unseen = list(scene.localise(held_out, Monitor()).values())
        for count in range(FIRST, max(counts) + 1):
            scene.add(names[:count], Monitor())
            began = time.process_time()
            quick = scene.train("quick", Monitor())
            growing_s += time.process_time() - began
            if count not in counts:
                continue
            began = time.process_time()
            full = scene.train("full", Monitor())
            yield {
                "dataset": dataset.name,
                "spread": spread,
                "seed": settings.seed,
                "views": count,
                "quick, dB": quality_db(quick, unseen, rasterizer),
                "full, dB": quality_db(full, unseen, rasterizer),
                "all quick models so far, processor s": growing_s,
                "full model, processor s": time.process_time() - began,
            }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 20, 40])
    parser.add_argument("--spread", nargs="+", choices=list(SPREADS), default=list(SPREADS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    dataset, rasterizer = open_dataset(options.dataset, options.colmap), create_rasterizer(options.backend)
    training = SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians})
    found = []
    for spread in options.spread:
        for seed in options.seeds:
            settings = SceneSettings(
                poses="known", long_side_px=options.long_side, training=training, seed=seed
            )
            for row in rows(dataset, spread, settings, options.counts, rasterizer):
                print(row, flush=True)
                found.append(row)
    report(f"growth, {options.long_side} px, {rasterizer.name}", found, options.json)


if __name__ == "__main__":
    main()
