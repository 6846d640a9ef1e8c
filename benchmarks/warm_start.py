"""A quick model that continues from a full one, beside one that is trained anew.

    python benchmarks/warm_start.py DATASET [--colmap MODEL] [--counts 10+1 20+1 20+5] [--spread far near]
        [--seed 0] [--long-side 256] [--max-gaussians 25000] [--json warm_start.json]

Known poses. ``20+5``: a full model of 20 views, then quick models of 25, and a full one of them. Every eighth
view is held out. The rank correlation (Spearman) is that of the ranking by median frequency with the last
full model's; the candidates are unvisited views and moved and turned visited ones. The processor time is that
of training (run it with NUMBA_NUM_THREADS=1 and OMP_NUM_THREADS=1, else waiting threads count, too).
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from growth import SPREADS, quality_db
from measurement import report
from scipy.spatial.transform import Rotation
from scipy.stats import spearmanr

from fvs_engine.geometry import RigidTransform
from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SCENE_TRAINING, ModelQuality, SceneSettings
from fvs_engine.score import MedianFrequency
from fvs_engine.select.initial_views import initial_views
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.views import TrainingView

MOST_UNVISITED, MOVED = 30, 24
TURN_DEG, MOVE_SHARE = 10.0, 0.2
"""Standard deviations of the moved candidates' turns, and of their moves in shares of the views' spread."""


def moved(views: tuple[TrainingView, ...]) -> list[TrainingView]:
    """Some of the views, moved and turned at random."""
    draw = np.random.default_rng(0)
    spread = np.linalg.norm(np.stack([view.centre for view in views]).std(axis=0))
    candidates = []
    for index in draw.choice(len(views), min(MOVED, len(views)), replace=False):
        view = views[index]
        turn = Rotation.from_rotvec(np.radians(TURN_DEG) * draw.normal(size=3)).as_matrix()
        rotation = turn @ view.camera_from_model.rotation
        centre = view.centre + MOVE_SHARE * spread * draw.normal(size=3)
        pose = RigidTransform(rotation, -rotation @ centre)
        candidates.append(replace(view, name=f"near {view.name}", camera_from_model=pose))
    return candidates


def rows(
    dataset: Dataset, spread: str, settings: SceneSettings, before: int, more: int, rasterizer: Rasterizer
) -> Iterator[dict[str, Any]]:
    """The models before and after, one row each."""
    pool, held_out = hold_out(dataset.names, 8)
    names = initial_views([dataset.by_name[name] for name in pool], before + more, SPREADS[spread], 0)

    def trained(scene: Scene, quality: ModelQuality) -> tuple[SceneModel, float]:
        began = time.process_time()
        return scene.train(quality, Monitor()), time.process_time() - began

    with tempfile.TemporaryDirectory() as folder:
        warm, anew = (
            Scene.open(
                Path(folder, str(goes_on)),
                dataset,
                settings.model_copy(update={"warm_starts": goes_on}),
                rasterizer,
                Monitor(),
            )
            for goes_on in (True, False)
        )
        warm.add(names[:before], Monitor())
        models = {"full, before": trained(warm, "full")}
        for scene in (warm, anew):
            scene.add(names, Monitor())
        models["quick, warm"] = trained(warm, "quick")
        models["quick, anew"] = trained(anew, "quick")
        models["full, after"] = trained(anew, "full")
        unvisited = [name for name in pool if name not in names][:MOST_UNVISITED]
        candidates = [*anew.localise(unvisited, Monitor()).values(), *moved(anew.views)]
        unseen = list(anew.localise(held_out, Monitor()).values())
        new = [view for view in anew.views if view.name in names[before:]]
    scores = {
        name: [found.score for found in MedianFrequency().score(model.gaussians, candidates, rasterizer)]
        for name, (model, _) in models.items()
    }
    for name, (model, seconds) in models.items():
        yield {
            "dataset": dataset.name,
            "spread": spread,
            "views": f"{before} + {more}",
            "model": name,
            "held out, dB": quality_db(model, unseen, rasterizer),
            "new views, dB": quality_db(model, new, rasterizer),
            "rank correlation": float(spearmanr(scores[name], scores["full, after"])[0]),
            "training, processor s": seconds,
            "Gaussians": len(model.gaussians),
        }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--counts", nargs="+", default=["10+1", "20+1", "20+5"])
    parser.add_argument("--spread", nargs="+", choices=list(SPREADS), default=list(SPREADS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--iterations", type=int, nargs=2, default=[2_000, 40], help="at least; per view")
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    dataset, rasterizer = open_dataset(options.dataset, options.colmap), create_rasterizer(options.backend)
    least, per_view = options.iterations
    settings = SceneSettings(
        poses="known",
        long_side_px=options.long_side,
        initial_iterations=least,
        iterations_per_view=per_view,
        training=SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians}),
        seed=options.seed,
    )
    found = []
    for spread in options.spread:
        for counts in options.counts:
            before, more = (int(count) for count in counts.split("+"))
            for row in rows(dataset, spread, settings, before, more, rasterizer):
                print(row, flush=True)
                found.append(row)
    report(f"warm starts, {options.long_side} px, {rasterizer.name}", found, options.json)


if __name__ == "__main__":
    main()
