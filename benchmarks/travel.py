"""PSNR against travel: what selectors reach with a quarter, a half, … of the way that ``farthest`` needs.

    python benchmarks/travel.py DATASET [--colmap MODEL] [--views 20] [--seeds 0 1 2]
        [--methods kriging farthest uniform random median-frequency] [--long-side 256] [--json travel.json]

Known poses. From four initial views side by side, any view may be next. The way of ``farthest`` through
``--views`` views is the unit. ``kriging`` plans at most that many views for each distance; the ways of the
others end where the distance is used up, ``median-frequency`` choosing by models that are trained on the way.
Every set is trained from scratch; PSNR over all views that no method may hold out and this one did not visit.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from growth import quality_db
from measurement import report
from view_sets import chosen, with_points

from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.reach import Reach
from fvs_engine.plan.route import StraightLegs
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget, plan_tours
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.dataset_folder import open_dataset
from fvs_engine.scene.growing_scene import GrowingScene
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.select.initial_views import initial_views
from fvs_engine.select.loop import LoopSettings, SelectionLoop, StepRecord
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView

INITIAL = 4
QUARTERS = (0.25, 0.5, 0.75, 1.0)


def planned(views: dict[str, PinholeView], initial: tuple[str, ...], most: int, distance: float) -> list[str]:
    """The views of a tour within a distance."""
    later = [view for name, view in views.items() if name not in initial]
    targets = Targets([views[name] for name in initial], later)
    places = np.concatenate([targets.centres, views[initial[-1]].centre[None]])
    (tour,) = plan_tours(
        targets.variance,
        Budget(most - len(initial), distance),
        targets.admissible,
        StraightLegs(places),
        [len(later)],
    )
    return [later[index].name for index in tour.views]


def by_renders(
    dataset: Dataset, settings: SceneSettings, method: str, most: int, seed: int, rasterizer: Rasterizer
) -> list[str]:
    """The way of a selector that looks at the model."""
    loop_settings = LoopSettings(
        scene=settings,
        method=method,
        initial=INITIAL,
        initial_choice="consecutive",
        budget=most,
        nearest=len(dataset.views),
        seed=seed,
    )
    with tempfile.TemporaryDirectory() as folder:
        loop = SelectionLoop.open(Path(folder) / "loop", dataset, loop_settings, rasterizer, Monitor())
        while isinstance(loop.step(Monitor()), StepRecord):
            pass
        return list(loop.visited)


def within(names: list[str], views: dict[str, PinholeView], distance: float) -> list[str]:
    """The part of a way that a distance reaches, from its first four views on."""
    taken = names[:INITIAL]
    for name in names[INITIAL:]:
        if path_length([views[n].centre for n in (*taken[INITIAL - 1 :], name)]) > distance:
            break
        taken.append(name)
    return taken


def rows(
    dataset: Dataset, options: argparse.Namespace, seed: int, rasterizer: Rasterizer
) -> list[dict[str, Any]]:
    """One row per selector and quarter."""
    training = SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians})
    settings = SceneSettings(poses="known", long_side_px=options.long_side, training=training, seed=seed)
    pool, _ = hold_out(dataset.names, 8)
    initial = initial_views([dataset.by_name[name] for name in pool], INITIAL, "consecutive", seed)
    with tempfile.TemporaryDirectory() as folder:
        scene = GrowingScene.open(Path(folder), dataset, settings, rasterizer, Monitor())
        images = scene.localise(dataset.names, Monitor())
    views: dict[str, PinholeView] = {name: images[name] for name in pool}
    ways: dict[str, list[str]] = {}
    for method in ("farthest", *(m for m in options.methods if m not in ("farthest", "kriging"))):
        if method in ("median-frequency", "spectral-median", "coverage", "fisher", "d-optimal"):
            ways[method] = by_renders(dataset, settings, method, options.views, seed, rasterizer)
        else:
            anywhere = Reach(nearest=len(views))
            ways[method] = list(chosen(views, initial, method, options.views, seed, anywhere, rasterizer)[0])
    unit = path_length([views[name].centre for name in ways["farthest"][INITIAL - 1 :]])
    found: list[dict[str, Any]] = []
    for quarter in QUARTERS:
        for method in options.methods:
            if method == "kriging":
                names = [*initial, *planned(views, initial, options.views, quarter * unit)]
            else:
                names = within(ways[method], views, quarter * unit * (1 + 1e-9))
            with tempfile.TemporaryDirectory() as folder:
                scene = GrowingScene.open(Path(folder), dataset, settings, rasterizer, Monitor())
                scene.add(names, Monitor())
                model = scene.train("full", Monitor())
            found.append(
                {
                    "dataset": dataset.name,
                    "seed": seed,
                    "share of farthest's travel": quarter,
                    "selector": method,
                    "views": len(names),
                    "travel": path_length([views[name].centre for name in names[INITIAL - 1 :]]),
                    "unvisited, dB": quality_db(
                        model, [images[n] for n in dataset.names if n not in names], rasterizer
                    ),
                }
            )
            print(found[-1], flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument(
        "--methods", nargs="+", default=["kriging", "farthest", "uniform", "random", "median-frequency"]
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    rasterizer = create_rasterizer(options.backend)
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        dataset = with_points(open_dataset(options.dataset, options.colmap), Path(folder))
        for seed in options.seeds:
            found += rows(dataset, options, seed, rasterizer)
    table = []
    for quarter in QUARTERS:
        for method in options.methods:
            some = [r for r in found if (r["share of farthest's travel"], r["selector"]) == (quarter, method)]
            table.append(
                {
                    "share of farthest's travel": quarter,
                    "selector": method,
                    "views": float(np.mean([row["views"] for row in some])),
                    "travel": float(np.mean([row["travel"] for row in some])),
                    "unvisited, dB": float(np.mean([row["unvisited, dB"] for row in some])),
                }
            )
    report(f"PSNR against travel, {options.long_side} px, {rasterizer.name}", table, options.json)


if __name__ == "__main__":
    main()
