"""Updates of a model that optimise only what a new view and its neighbours see, beside others.

    python benchmarks/local_updates.py DATASET [--colmap MODEL] [--first 20] [--more 20] [--spread far near]
        [--iterations 30 60] [--seeds 0 1 2] [--long-side 256] [--max-gaussians 25000]
        [--json local_updates.json]

Known poses. From a full model of the first views, views are added one by one, Gaussians on their new sparse
points with them, and the model is trained for some iterations after each, every second one on the new view:
*all*: on all views and Gaussians; *local*: on the new view and its four neighbours, and what these
see. *anew*: the full model of all views. Every eighth view is held out. The processor time is that of all
updates (run it with NUMBA_NUM_THREADS=1 and OMP_NUM_THREADS=1, else waiting threads count, too).
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from growth import SPREADS, quality_db
from measurement import report

from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import view_distances
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.seeding import seeds_on_points
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.select.initial_views import initial_views
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.settings import Densification
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView, scene_extent

NEIGHBOURS = 4


def with_new_points(model: SceneModel, before: PointCloud, now: PointCloud, room: int) -> SceneModel:
    """The model with Gaussians on the points that were not there before, as far as there is room."""
    known = {tuple(xyz) for xyz in before.xyz.tolist()}
    new = np.array([tuple(xyz) not in known for xyz in now.xyz.tolist()], dtype=bool)
    seeds = seeds_on_points(PointCloud(now.xyz[new], now.colors[new]), max(0, room - len(model.gaussians)))
    if not len(seeds):
        return model
    added = seeds.gaussians(model.gaussians.sh_degree)
    both = zip(model.gaussians.tensors().values(), added.tensors().values(), strict=True)
    return replace(model, gaussians=Gaussians(*(torch.cat([a.detach(), b]) for a, b in both)))


def updated(
    model: SceneModel,
    views: tuple[TrainingView, ...],
    new: TrainingView,
    iterations: int,
    local: bool,
    settings: SceneSettings,
    rasterizer: Rasterizer,
) -> SceneModel:
    """The model after some iterations, every second one on the new view."""
    others = [view for view in views if view.name != new.name]
    seen = torch.ones(len(model.gaussians), dtype=torch.bool)
    if local:
        nearest = np.argsort(view_distances([new], others)[0])[:NEIGHBOURS]
        others = [others[index] for index in nearest]
        with torch.no_grad():
            radii = [
                rasterizer.render(model.gaussians, view.camera, view.camera_from_model).radii_px
                for view in (new, *others)
            ]
        seen = torch.stack(radii).amax(dim=0) > 0
    training = settings.training.model_copy(
        update={"levels": (), "densification": Densification(last_iteration=0)}
    )
    trainer = Trainer(
        [new, *others],
        Gaussians(*(tensor[seen].detach().clone() for tensor in model.gaussians.tensors().values())),
        training,
        rasterizer,
        settings.seed,
        [len(others)] + [1] * len(others),
    )
    trainer.iteration = model.iterations
    trainer.extent = scene_extent(views, model.gaussians.means.numpy())
    trainer.train(model.iterations + iterations, Monitor())
    tensors = []
    for tensor, part in zip(
        model.gaussians.tensors().values(), trainer.gaussians.tensors().values(), strict=True
    ):
        whole = tensor.detach().clone()
        whole[seen] = part.detach()
        tensors.append(whole)
    return replace(model, gaussians=Gaussians(*tensors))


def rows(
    dataset: Dataset,
    spread: str,
    settings: SceneSettings,
    options: argparse.Namespace,
    rasterizer: Rasterizer,
) -> Iterator[dict[str, Any]]:
    """One row per way and number of iterations."""
    pool, held_out = hold_out(dataset.names, 8)
    count = options.first + options.more
    views = [dataset.by_name[name] for name in pool]
    names = initial_views(views, count, SPREADS[spread], settings.seed)
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.open(Path(folder), dataset, settings, rasterizer, Monitor())
        unseen = list(scene.localise(held_out, Monitor()).values())
        scene.add(names[: options.first], Monitor())
        before = scene.train("full", Monitor())
        states = [(scene.views, scene._points)]
        for number in range(options.first + 1, count + 1):
            scene.add(names[:number], Monitor())
            states.append((scene.views, scene._points))
        began = time.process_time()
        anew = scene.train("full", Monitor())
        anew_s = time.process_time() - began

    def row(way: str, model: SceneModel, seconds: float) -> dict[str, Any]:
        return {
            "dataset": dataset.name,
            "spread": spread,
            "seed": settings.seed,
            "views": f"{options.first} + {options.more}",
            "model": way,
            "held out, dB": quality_db(model, unseen, rasterizer),
            "processor s": seconds,
            "Gaussians": len(model.gaussians),
        }

    yield row("before", before, 0.0)
    yield row("anew", anew, anew_s)
    for iterations in options.iterations:
        for local in (False, True):
            model, began = before, time.process_time()
            for (_, points), (now, points_now), name in zip(
                states, states[1:], names[options.first :], strict=False
            ):
                new = next(view for view in now if view.name == name)
                model = with_new_points(model, points, points_now, settings.training.max_gaussians)
                model = updated(model, now, new, iterations, local, settings, rasterizer)
            way = f"{'local' if local else 'all'}, {iterations} iterations"
            yield row(way, model, time.process_time() - began)


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--first", type=int, default=20)
    parser.add_argument("--more", type=int, default=20)
    parser.add_argument("--spread", nargs="+", choices=list(SPREADS), default=list(SPREADS))
    parser.add_argument("--iterations", type=int, nargs="+", default=[30, 60])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    dataset, rasterizer = open_dataset(options.dataset, options.colmap), create_rasterizer("cpu")
    found = []
    for spread in options.spread:
        for seed in options.seeds:
            settings = SceneSettings(
                poses="known",
                long_side_px=options.long_side,
                training=SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians}),
                seed=seed,
            )
            for row in rows(dataset, spread, settings, options, rasterizer):
                print(row, flush=True)
                found.append(row)
    report(f"local updates, {options.long_side} px", found, options.json)


if __name__ == "__main__":
    main()
