"""Quality of sets of views that were chosen by their poses alone, each trained from scratch.

    python benchmarks/view_sets.py DATASET [--colmap MODEL] [--selectors random farthest kriging]
        [--counts 10 20] [--seeds 0 1 2 3 4 5] [--initial 4] [--nearest 5 | --radius] [--training-seeds 0]
        [--hold-out every-8th random] [--long-side 256] [--max-gaussians 25000] [--json view_sets.json]

Known poses. From initial views that the seed draws (far apart; side by side with --nearest and --radius), a
selector runs until the count is reached, and the full model of the set is trained. ``planned`` is `kriging`
from initial views that it plans, too. PSNR over the held-out
views and over all views that were not visited; travel in the dataset's unit, by the order of choice. The
second table has the differences to ``farthest``, paired by seed, with 95 % intervals.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from growth import quality_db
from measurement import report
from scipy.stats import t as student_t

from fvs_engine.choices import InitialChoice
from fvs_engine.hold_out import hold_out
from fvs_engine.lab.baselines import create_selector
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.reach import Reach, default_radius
from fvs_engine.scene.dataset import Dataset, open_dataset, read_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.score.selectors.interface import SelectionContext, select
from fvs_engine.select.initial_views import initial_views
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.report import GIVEN
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView

HELD_OUT_SHARE = 8
_NOTHING = Gaussians(
    means=torch.zeros(0, 3),
    log_scales=torch.zeros(0, 3),
    quaternions_wxyz=torch.zeros(0, 4),
    opacity_logits=torch.zeros(0),
    sh_dc=torch.zeros(0, 3),
    sh_rest=torch.zeros(0, 0, 3),
)
"""A model for selectors that do not look at it."""
BASELINE = "farthest"
PLANNED = "planned"


def with_points(dataset: Dataset, folder: Path) -> Dataset:
    """The dataset, with the points that all its views share: else every set would triangulate its own."""
    if dataset.points is not None:
        return dataset
    given = Reconstruction.of_views(dataset.views)
    triangulate(given, dataset.image_dir, folder, SfmSettings(), Monitor())
    return read_dataset(dataset.image_dir, colmap=SfmFolder(folder).mapping(GIVEN))


def parts(dataset: Dataset, way: str, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Views that may be visited, and held-out ones: every eighth, or as many drawn by the seed."""
    pool, held_out = hold_out(dataset.names, HELD_OUT_SHARE)
    if way == "every-8th":
        return pool, held_out
    drawn = np.random.default_rng(seed).choice(len(dataset.names), len(held_out), replace=False)
    names = set(np.array(dataset.names)[drawn].tolist())
    return tuple(name for name in dataset.names if name not in names), tuple(sorted(names))


def chosen(
    views: dict[str, PinholeView],
    initial: tuple[str, ...],
    method: str,
    count: int,
    seed: int,
    reach: Reach,
    rasterizer: Rasterizer,
) -> tuple[tuple[str, ...], float]:
    """The names of ``count`` views, and the seconds of a choice."""
    selector, visited = create_selector("kriging" if method == PLANNED else method), list(initial)
    centres = {name: view.centre for name, view in views.items()}
    began = time.process_time()
    while len(visited) < count:
        unvisited = {name: centre for name, centre in centres.items() if name not in visited}
        distances = reach.distances(centres[visited[-1]], unvisited)
        context = SelectionContext(
            gaussians=_NOTHING,
            rasterizer=rasterizer,
            sh_degree=0,
            visited=tuple(views[name] for name in visited),
            candidates=tuple(views[name] for name in distances),
            order={name: place for place, name in enumerate(views)},
            budget=count,
            seed=seed,
            step=len(visited) - len(initial),
            later=tuple(views[name] for name in unvisited),
            reach=reach,
        )
        visited.append(select(context, selector, distances).chosen)
    return tuple(visited), (time.process_time() - began) / max(1, count - len(initial))


def rows(
    dataset: Dataset, options: argparse.Namespace, way: str, seed: int, rasterizer: Rasterizer
) -> list[dict[str, Any]]:
    """One row per selector, count and training seed."""
    pool, held_out = parts(dataset, way, seed)
    drawn: InitialChoice = "consecutive" if options.nearest or options.radius else "farthest"
    if options.radius:
        reach = Reach(radius=default_radius(np.stack([view.centre for view in dataset.views])))
    else:
        reach = Reach(nearest=options.nearest or len(pool))
    found: list[dict[str, Any]] = []
    for count in options.counts:
        for method in options.selectors:
            choice = "planned" if method == PLANNED else drawn
            given = [dataset.by_name[name] for name in pool]
            initial = initial_views(given, options.initial, choice, seed, count)
            sets: dict[int, dict[str, Any]] = {}
            for training_seed in options.training_seeds:
                training = SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians})
                settings = SceneSettings(
                    poses="known",
                    long_side_px=options.long_side,
                    training=training,
                    seed=1_000 * seed + training_seed,
                )
                with tempfile.TemporaryDirectory() as folder:
                    scene = Scene.open(Path(folder), dataset, settings, rasterizer, Monitor())
                    views = scene.localise(dataset.names, Monitor())
                    poses = {name: views[name] for name in pool}
                    names, seconds = chosen(poses, initial, method, count, seed, reach, rasterizer)
                    scene.add(names, Monitor())
                    model = scene.train("full", Monitor())
                    unvisited = [views[name] for name in dataset.names if name not in names]
                    sets[training_seed] = {
                        "dataset": dataset.name,
                        "hold-out": way,
                        "seed": seed,
                        "views": count,
                        "selector": method,
                        "training seed": training_seed,
                        "held-out, dB": quality_db(model, [views[n] for n in held_out], rasterizer),
                        "unvisited, dB": quality_db(model, unvisited, rasterizer),
                        "travel": path_length([dataset.by_name[name].centre for name in names]),
                        "choice, ms": 1e3 * seconds,
                        "set": list(names),
                    }
            for row in sets.values():
                print({key: value for key, value in row.items() if key != "set"}, flush=True)
                found.append(row)
    return found


def differences(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean paired difference to the baseline per dataset, hold-out, count and selector."""
    table = []
    groups = sorted({(row["dataset"], row["hold-out"], row["views"], row["selector"]) for row in found})
    for group in groups:
        dataset, way, count, method = group
        if method == BASELINE:
            continue
        row = {"dataset": dataset, "hold-out": way, "views": count, "selector": method}
        for measure in ("held-out, dB", "unvisited, dB", "travel"):
            means = [
                {
                    seed: np.mean([r[measure] for r in found if _key(r) == (dataset, way, count, name, seed)])
                    for seed in {r["seed"] for r in found if _key(r)[:4] == (dataset, way, count, name)}
                }
                for name in (method, BASELINE)
            ]
            both = sorted(means[0].keys() & means[1].keys())
            apart = np.array([means[0][seed] - means[1][seed] for seed in both])
            row[f"Δ {measure}"] = float(apart.mean()) if len(apart) else float("nan")
            if len(apart) > 1:
                error = apart.std(ddof=1) / np.sqrt(len(apart))
                row[f"± {measure}"] = float(student_t.ppf(0.975, len(apart) - 1) * error)
        table.append(row)
    return table


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["dataset"], row["hold-out"], row["views"], row["selector"], row["seed"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--selectors", nargs="+", default=["random", BASELINE, "kriging"])
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 20])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4, 5])
    parser.add_argument("--training-seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--initial", type=int, default=4)
    limits = parser.add_mutually_exclusive_group()
    limits.add_argument("--nearest", type=int)
    limits.add_argument("--radius", action="store_true", help="the paper's: views within 8 median spacings")
    parser.add_argument("--hold-out", nargs="+", choices=["every-8th", "random"], default=["every-8th"])
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    rasterizer = create_rasterizer(options.backend)
    found = []
    with tempfile.TemporaryDirectory() as folder:
        dataset = with_points(open_dataset(options.dataset, options.colmap), Path(folder))
        for way in options.hold_out:
            for seed in options.seeds:
                found += rows(dataset, options, way, seed, rasterizer)
    shown = [{key: value for key, value in row.items() if key != "set"} for row in found]
    report(f"sets of views, {options.long_side} px, {rasterizer.name}", shown, options.json)
    report(f"difference to {BASELINE}, paired by seed", differences(found), None)


if __name__ == "__main__":
    main()
