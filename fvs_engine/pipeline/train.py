"""Training on the undistorted views of an output folder: resumable, evaluated at the end."""

import os
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from PIL import Image

from fvs_engine.files.storage import require_free_bytes, storage_errors
from fvs_engine.hold_out import hold_out_views
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import (
    Manifest,
    Metrics,
    ReconstructionSettings,
    TrainingRecord,
    ViewMetrics,
)
from fvs_engine.pipeline.model import model_views, read_undistorted
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.quality import comparisons
from fvs_engine.scene.scene_model import SceneModel, usual_camera
from fvs_engine.splat.device_memory import training_bytes
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.render import to_pixels
from fvs_engine.splat.session import open_trainer, train_saving
from fvs_engine.splat.settings import PRESETS, TrainingSettings, memory_need_bytes
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView
from fvs_schema.findings import Finding, FindingCode

_BYTES_PER_GAUSSIAN = 1_000
"""A checkpoint at SH degree 3 (parameters and Adam's moments) and the PLY, both twice while replaced."""


def training_settings(settings: ReconstructionSettings) -> TrainingSettings:
    """The preset, with the number of iterations of ``settings``."""
    preset = PRESETS[settings.quality]
    return preset if settings.iterations is None else preset.with_iterations(settings.iterations)


def disk_need_bytes(settings: ReconstructionSettings) -> int:
    """Approximate upper bound of the size of the checkpoint and the point cloud."""
    return training_settings(settings).max_gaussians * _BYTES_PER_GAUSSIAN


def train(workspace: Workspace, manifest: Manifest, *, monitor: Monitor) -> Metrics:
    """Train up to the iterations of ``manifest.settings``, evaluate, and write the results.

    Resumes from the folder's checkpoint. A checkpoint, the point cloud and the manifest are written every
    minute, at the end and on cancellation, which raises ``Cancelled``. The finished model of quality ``fine``
    is without floaters, which the checkpoint keeps.
    """
    settings = training_settings(manifest.settings)
    finished = workspace.read_metrics()
    if finished is not None and finished.iterations >= settings.iterations:
        monitor.warn(Finding.of(FindingCode.ALREADY_TRAINED, iterations=finished.iterations))
        return finished

    long_side_px = manifest.settings.training_long_side_px
    reconstruction = read_undistorted(workspace)
    views = model_views(reconstruction, long_side_px)
    training, held_out = hold_out_views(views, manifest.settings.test_every)
    if not held_out and manifest.settings.test_every:
        monitor.warn(Finding.of(FindingCode.NONE_HELD_OUT, views=len(views)))
    rasterizer = create_rasterizer(manifest.settings.backend, monitor)
    photographs = Photographs(workspace.undistorted_images, long_side_px)
    loaded = photographs.load_all(training, monitor)
    if not workspace.checkpoint.exists():
        require_free_bytes(workspace.root, disk_need_bytes(manifest.settings))
    trainer = open_trainer(
        workspace.checkpoint,
        loaded,
        (reconstruction.points.xyz, reconstruction.points.colors),
        settings,
        rasterizer,
        manifest.settings.seed,
    )
    _warn_of_memory(settings, loaded, rasterizer.device, monitor)
    state = _State(workspace, manifest, trainer, loaded, held_out)
    train_saving(trainer, settings.iterations, monitor, state.save)
    state.save()
    model = SceneModel.of(trainer)
    if manifest.settings.quality == "fine":
        model = model.without_floaters(loaded, reconstruction.points, rasterizer, monitor)
        state.save(model)
    unseen = photographs.load_all(held_out, monitor)
    metrics = _evaluate(workspace, model, rasterizer, unseen, state.seconds, monitor)
    workspace.write_metrics(metrics)
    return metrics


class _State:
    """Writes the state of a training run: checkpoint, point cloud and manifest."""

    def __init__(
        self,
        workspace: Workspace,
        manifest: Manifest,
        trainer: Trainer,
        training: Sequence[TrainingView],
        held_out: tuple[PinholeView, ...],
    ) -> None:
        self._workspace = workspace
        self._manifest = manifest
        self._trainer = trainer
        self._training = training
        self._held_out = held_out
        self._seconds_before = manifest.training.seconds if manifest.training else 0.0
        self._began = time.monotonic()
        self.seconds = self._seconds_before
        """Seconds of training up to the last save, those of earlier runs included."""

    def save(self, finished: SceneModel | None = None) -> None:
        """Write the checkpoint, then the point cloud, then the manifest that describes them.

        The point cloud is that of the ``finished`` model, or of the one in training.
        """
        model = finished or SceneModel.of(self._trainer)
        self.seconds = self._seconds_before + time.monotonic() - self._began
        camera = usual_camera(self._training)
        with storage_errors(self._workspace.checkpoint):
            self._workspace.checkpoint.parent.mkdir(exist_ok=True)
            self._trainer.save(self._workspace.checkpoint)
            cameras = self._manifest.cameras
            origin = cameras.origin if cameras else (0.0, 0.0, 0.0)
            model.export(self._workspace.point_cloud, origin)
        record = TrainingRecord(
            train_views=tuple(view.name for view in self._training),
            counted_shares={
                view.name: view.counted_share for view in self._training if view.counted_share < 1.0
            },
            test_views=tuple(view.name for view in self._held_out),
            width_px=camera.width,
            height_px=camera.height,
            iterations=self._trainer.iteration,
            target_iterations=self._trainer.settings.iterations,
            gaussians=len(model.gaussians),
            seconds=self.seconds,
        )
        self._workspace.write_manifest(self._manifest.model_copy(update={"training": record}))


def _warn_of_memory(
    settings: TrainingSettings, views: Sequence[TrainingView], device: torch.device, monitor: Monitor
) -> None:
    """Warn when training may need more memory than the machine, or its GPU, has."""
    if device.type == "cuda":
        need_bytes = training_bytes(settings, views)
        machine_bytes = torch.cuda.get_device_properties(device).total_memory
    else:
        largest = max((view.camera for view in views), key=lambda camera: camera.width * camera.height)
        need_bytes = memory_need_bytes(
            settings.max_gaussians, settings.sh_degree, len(views), largest.width, largest.height
        )
        machine_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if need_bytes > machine_bytes:
        need_gb, machine_gb = need_bytes / 1e9, machine_bytes / 1e9
        monitor.warn(Finding.of(FindingCode.LITTLE_MEMORY, need_gb=need_gb, machine_gb=machine_gb))


def _evaluate(
    workspace: Workspace,
    model: SceneModel,
    rasterizer: Rasterizer,
    held_out: Sequence[TrainingView],
    training_seconds: float,
    monitor: Monitor,
) -> Metrics:
    """Render and measure the held-out views; write each beside its photograph. Stage ``evaluate``."""
    results = []
    folder = workspace.renders / "held-out"
    model = replace(model, sh_degree=model.gaussians.sh_degree)
    for each in comparisons(model, held_out, rasterizer, monitor):
        results.append(ViewMetrics(name=each.view.name, psnr_db=each.psnr_db, ssim=each.ssim))
        path = folder / f"{each.view.name}.png"
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.concatenate([each.view.image, to_pixels(each.render)], axis=1)).save(path)
    return Metrics(
        views=tuple(results),
        psnr_db=float(np.mean([view.psnr_db for view in results])) if results else None,
        ssim=float(np.mean([view.ssim for view in results])) if results else None,
        iterations=model.iterations,
        gaussians=len(model.gaussians),
        training_seconds=training_seconds,
        peak_memory_bytes=_peak_memory_bytes(),
    )


def _peak_memory_bytes() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
