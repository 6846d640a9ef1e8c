"""Quality on held-out views: renders compared with photographs that were never trained on."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from fvs_engine.lab.evaluate.results import Evaluation, Repeat, ViewQuality
from fvs_engine.monitor import Monitor
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.quality import Comparison
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.select.candidate_views import align
from fvs_engine.select.loop import SelectionLoop
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.views import TrainingView
from fvs_schema.stages import Stage

Lpips = Callable[[ArrayLike, ArrayLike], float]


_SEEDS_APART = 1_000
"""Distance between the seeds of trainings of the same views; runs have small seeds."""


def evaluate(
    loop: SelectionLoop, monitor: Monitor, lpips: Lpips | None = None, trainings: int = 1
) -> Evaluation:
    """Evaluate the full model, trained first if it is not there, on the held-out photographs.

    Stage ``evaluate``, after those of training.

    With known poses their cameras are those of the dataset. With estimated ones each photograph is localised
    in the current model by its own features, so that the measure is of the model and not of the alignment;
    one that cannot be localised gets the dataset's camera, moved by the alignment.

    The unvisited views are rendered, too. With more than one of ``trainings`` other models of the same views
    are trained, and measured by their PSNR.
    """
    scene = loop.scene
    model = scene.train("full", monitor)
    localised = scene.localise(loop.held_out_names, monitor)
    missing = tuple(name for name in loop.held_out_names if name not in localised)
    views = [*localised.values(), *aligned_views(loop, missing)]
    qualities = []
    with on_device(scene.rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            qualities.append(_quality(model, view, scene.rasterizer, lpips))
            monitor.report(Stage.EVALUATE, done, len(views))
        unvisited_db = _unvisited_db(loop, model, monitor)
        repeats = []
        for number in range(1, trainings):
            seed = scene.settings.seed + _SEEDS_APART * number
            other = scene.train_again(seed, monitor)
            at_held_out = (psnr_at(other, view, scene.rasterizer) for view in views)
            repeats.append(
                Repeat(
                    seed=seed,
                    psnr_db=float(np.mean(list(at_held_out))),
                    unvisited_db=_unvisited_db(loop, other, monitor),
                )
            )
    mean_lpips = None
    if lpips is not None:
        mean_lpips = float(np.mean([quality.lpips for quality in qualities]))
    return Evaluation(
        visited=len(loop.visited),
        registered=len(scene.views),
        iterations=model.iterations,
        gaussians=len(model.gaussians),
        travel=loop.travel,
        psnr_db=float(np.mean([quality.psnr_db for quality in qualities])),
        ssim=float(np.mean([quality.ssim for quality in qualities])),
        lpips=mean_lpips,
        aligned_only=missing,
        views=tuple(qualities),
        unvisited_db=unvisited_db,
        repeats=tuple(repeats),
        flown=tuple(vehicle.flown for vehicle in loop.vehicles.all),
    )


def _unvisited_db(loop: SelectionLoop, model: SceneModel, monitor: Monitor) -> float | None:
    """Mean PSNR over the unvisited views, at the dataset's poses; None without any."""
    found = []
    for view in aligned_views(loop, loop.unvisited):
        monitor.check()
        found.append(psnr_at(model, view, loop.scene.rasterizer))
    return float(np.mean(found)) if found else None


def aligned_views(loop: SelectionLoop, names: Sequence[str]) -> Iterable[TrainingView]:
    """Photographs of the dataset with its poses, moved into the model by the alignment.

    They are read one by one: there may be as many as the dataset has.
    """
    if not names:
        return
    model_from_world = align(loop.scene).model_from_world
    photographs = Photographs(loop.dataset.image_dir, loop.scene.settings.long_side_px)
    for name in names:
        view = loop.dataset.by_name[name]
        model_from_camera = model_from_world.move_camera(view.camera_from_model.inverse())
        yield photographs.load(name, view.camera, model_from_camera.inverse())


def psnr_at(model: SceneModel, view: TrainingView, rasterizer: Rasterizer) -> float:
    """PSNR of the model's render of a view against its photograph."""
    return Comparison.of(model, view, rasterizer).psnr_db


def _quality(
    model: SceneModel, view: TrainingView, rasterizer: Rasterizer, lpips: Lpips | None
) -> ViewQuality:
    found = Comparison.of(model, view, rasterizer)
    return ViewQuality(
        name=view.name,
        psnr_db=found.psnr_db,
        ssim=found.ssim,
        lpips=None if lpips is None else lpips(*found.where_it_counts),
    )
