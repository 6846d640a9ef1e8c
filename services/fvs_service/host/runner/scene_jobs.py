"""A scene's jobs: register images, train the model, write the artifacts of a snapshot."""

import logging
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from functools import partial
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from fvs_engine.errors import (
    DamagedOutputError,
    OtherSettingsError,
    ReconstructionError,
    TrainingError,
)
from fvs_engine.hold_out import hold_out_views
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.final_model import FinalModel
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.quality import evenly_spaced, mean_psnr_db, measure
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_files import SceneFiles
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.growing.state import GrowthFolder
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.device_memory import training_bytes
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.settings import PRESETS
from fvs_engine.splat.views import TrainingView
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.images import Image, Registration
from fvs_schema.jobs import JobKind
from fvs_schema.snapshots import SnapshotMetrics
from fvs_schema.stages import Stage
from fvs_service.host.protocol.messages import ControlOutcome, JobOutcome, RunJob
from fvs_service.host.runner.artifacts import write_artifacts
from fvs_service.host.runner.control_points import StoredImages, control_outcome
from fvs_service.host.runner.gpu_memory import GpuMemory
from fvs_service.host.runner.image_files import discard_images, prepare_images
from fvs_service.host.runner.job_monitor import FirstModelMonitor, JobMonitor
from fvs_service.host.runner.pose_priors import pose_priors
from fvs_service.host.runner.scene_choice import choose, read_choice
from fvs_service.host.runner.scene_folder import SceneFolder
from fvs_service.host.runner.snapshot_models import SnapshotModels
from fvs_service.jobs.stages import FIRST_IMAGES, has_first_model
from fvs_service.settings import WorkerSettings
from fvs_service.storage.blobs import Blobs

_log = logging.getLogger(__name__)

_FIRST_TRIED = "first-model-tried"
"""Name of the file that marks a growing scene, also in the working copy, once a first model was tried."""
_MOST_EVALUATED = 16
"""New images that the previous snapshot is evaluated on, so that an update does not take much longer."""

Quarantine = Callable[[Mapping[str, Finding]], None]
"""Takes the digests of images to quarantine, with the reasons."""
Publish = Callable[[Literal["first", "quick"], JobOutcome], None]
"""Receives an update's intermediate models: that of the first images, and the quick one of all images."""


class SceneJobs:
    """Runs a scene's jobs, one at a time; keeps the growing scene in memory between them."""

    def __init__(
        self,
        folder: Path,
        blobs: Blobs,
        settings: WorkerSettings,
        rasterizer: Rasterizer,
        models: SnapshotModels,
        memory: GpuMemory,
    ) -> None:
        self._folder = SceneFolder(folder)
        self._blobs = blobs
        self._settings = settings
        self._rasterizer = rasterizer
        self._models = models
        self._memory = memory
        self._scene: Scene | None = None

    def run(
        self,
        request: RunJob,
        monitor: JobMonitor,
        quarantine: Quarantine = lambda _reasons: None,
        publish: Publish = lambda _name, _outcome: None,
    ) -> JobOutcome | None:
        """Run a job; a repeated call resumes it from its last checkpoint. Raises ``EngineError``.

        None when the request leaves the training to another host, which continues from the checkpoint.
        """
        try:
            if request.request.kind is not JobKind.UPDATE:
                return self._fine(request, monitor, quarantine)
            try:
                return self._update(request, monitor, quarantine, publish)
            except DamagedOutputError as damage:
                _log.warning("%s", damage)
                self._start_again(FindingCode.STARTED_AGAIN_AFTER_DAMAGE, monitor)
                return self._update(request, monitor, quarantine, publish)
        except BaseException:
            self._scene = None  # what is in memory may be ahead of what is on disk, or differ from it
            raise

    def forget(self) -> None:
        """Forget the growing scene, which has the photographs; the next job reads it from the folder."""
        self._scene = None

    def _update(
        self, request: RunJob, monitor: JobMonitor, quarantine: Quarantine, publish: Publish
    ) -> JobOutcome | None:
        """Register the images, train the quick model and publish it, then train the full one.

        When there is already a full model of these images, no quick one is published. A new scene of many
        images first gets a model of a few of them.
        """
        images = self._images(request, monitor, quarantine)
        if len(images) < 2:
            raise ReconstructionError(
                f"A model needs two usable images or more, and the scene has {len(images) or 'none'}.",
                hint="Send more images that overlap; start with eight or more.",
            )
        scene = self._open_scene(request, len(images), monitor)
        # An image that was included again after its quarantine is tried again.
        removed = [*(name for name in scene.visited if name not in images), *scene.quarantined]
        try:
            new = request.snapshot_id is None
            if request.trains and has_first_model(first=new, images=len(images)):
                self._publish_first(request, scene, images, monitor, publish)
            update = scene.add(tuple(images), monitor, pose_priors(images, request.origin), removed=removed)
        finally:
            quarantined = scene.quarantined
            found = {images[name].digest: why for name, why in quarantined.items() if name in images}
            _quarantine(found, monitor, quarantine)
        images = {name: image for name, image in images.items() if name not in quarantined}
        previous_db = self._evaluate_previous(request, scene, images, monitor)
        for finding in update.warnings:
            monitor.warn(finding)
        scene.save()
        if not request.trains and not scene.is_trained("full"):
            return None
        measured = {"new_images_psnr_db": previous_db}
        outcome = partial(self._outcome_of_update, request, scene, images, monitor, measured=measured)
        with self._memory_to_train(scene, monitor):
            if not scene.is_trained("full"):
                quick = scene.train("quick", monitor)
                monitor.report(Stage.QUICK_SNAPSHOT, 0, 1)
                publish("quick", outcome(quick, "quick"))
                if self._rasterizer.device.type == "cpu":  # a GPU has other scenes to train
                    monitor.wait_for_first_requests()
            full = scene.train("full", monitor)
        discard_images(self._folder.images, images)
        monitor.report(Stage.SNAPSHOT, 0, 1)
        return outcome(full, "full")

    def _publish_first(
        self,
        request: RunJob,
        scene: Scene,
        images: Mapping[str, Image],
        monitor: Monitor,
        publish: Publish,
    ) -> None:
        """Publish a quick model of the first images: rankings need not wait for the others.

        This is tried only once: to try again would remove the images that were added since.
        """
        tried = self._folder.growing / _FIRST_TRIED
        if tried.exists() or scene.visited:
            return
        tried.parent.mkdir(parents=True, exist_ok=True)
        tried.touch()
        first = dict(islice(images.items(), FIRST_IMAGES))
        stage = FirstModelMonitor(monitor)
        try:
            update = scene.add(tuple(first), stage, pose_priors(first, request.origin))
            for finding in update.warnings:
                numbers = finding.numbers | {"first_images": len(first)}
                monitor.warn(finding.model_copy(update={"numbers": numbers}))
            with self._memory_to_train(scene, stage):
                model = scene.train("quick", stage)
        except (ReconstructionError, TrainingError):
            return  # with the others they may support a model
        quarantined = scene.quarantined
        first = {name: image for name, image in first.items() if name not in quarantined}
        publish("first", self._outcome_of_update(request, scene, first, stage, model, "first"))

    def _outcome_of_update(
        self,
        request: RunJob,
        scene: Scene,
        images: Mapping[str, Image],
        monitor: Monitor,
        model: SceneModel,
        name: str,
        measured: Mapping[str, float | None] = MappingProxyType({}),
    ) -> JobOutcome:
        assert scene.model_dir is not None  # training needs views, whose poses are those of this model
        folder = self._folder.outcome(request.job_id) / name
        return self._outcome(
            folder,
            scene.views,
            images,
            model,
            scene.points,
            scene.model_dir,
            measured,
            control=partial(self._control, request, monitor),
            why_unregistered=scene.why_unregistered,
            compressed=name == "full",  # others are waited for, and soon replaced
        )

    def _evaluate_previous(
        self, request: RunJob, scene: Scene, images: Mapping[str, Image], monitor: Monitor
    ) -> float | None:
        """The PSNR of the latest snapshot at the new images, before the model is trained on them."""
        if request.snapshot_id is None:
            return None
        before = self._models.of_snapshot(request.snapshot_id)
        seen = {view.name for view in before.views}
        new = [view for view in scene.views if images[view.name].digest not in seen]
        views = evenly_spaced(new, _MOST_EVALUATED)
        with self._memory.for_renders(before, views, self._rasterizer, monitor) as rasterizer:
            return mean_psnr_db(before, views, rasterizer, monitor)

    def _images(self, request: RunJob, monitor: Monitor, quarantine: Quarantine) -> Mapping[str, Image]:
        """The images by the names of their files, without those that the engine rejects."""
        prepared = prepare_images(self._blobs, request.images, self._folder.images, monitor)
        _quarantine(prepared.rejected, monitor, quarantine)
        return prepared.files

    def _open_scene(self, request: RunJob, images: int, monitor: Monitor) -> Scene:
        choice = choose(self._folder, request.request, self._settings, images)
        if self._scene is None:
            settings = choice.settings(request.camera, self._settings.threads)
            try:
                self._scene = self._growing(settings, monitor)
            except OtherSettingsError:
                self._start_again(FindingCode.STARTED_AGAIN_WITH_SETTINGS, monitor)
                self._scene = self._growing(settings, monitor)
        return self._scene

    def _start_again(self, reason: FindingCode, monitor: Monitor) -> None:
        """Delete the growing scene, which the photographs suffice to make."""
        monitor.warn(Finding.of(reason))
        self._scene = None
        shutil.rmtree(self._folder.growing)

    def _growing(self, settings: SceneSettings, monitor: Monitor) -> Scene:
        dataset = Dataset("scene", self._folder.images, (), arriving=True)
        return Scene.open(self._folder.growing, dataset, settings, self._rasterizer, monitor)

    def _fine(self, request: RunJob, monitor: JobMonitor, quarantine: Quarantine) -> JobOutcome:
        placed = self._images(request, monitor, quarantine)
        final = FinalModel(self._fine_folder(request.job_id))
        cameras = final.cameras(self._growth.current_model, placed)
        wanted, settings = request.request, self._settings
        photographs = Photographs(self._folder.images, wanted.long_side_px or self._usual_side())
        views = photographs.load_all(cameras.views, monitor)
        trained, held_out = _split(views, wanted.test_every)
        if wanted.test_every is not None and not held_out:
            monitor.warn(Finding.of(FindingCode.NONE_HELD_OUT, views=len(views)))
        training = PRESETS["fine"].model_copy(update={"max_gaussians": settings.fine_max_gaussians})
        training = training.with_iterations(wanted.iterations or settings.fine_iterations)
        with self._memory.for_training(training_bytes(training, views), monitor):
            model = final.train(trained, cameras.points, training, self._rasterizer, monitor)
            quality = measure(model, held_out, self._rasterizer, monitor)
        measured = {} if quality is None else asdict(quality)
        # Images that arrived after the model's update are neither registered nor unregistered yet.
        posed = {view.name for view in views}
        images = {
            name: image
            for name, image in placed.items()
            if name in posed or image.registration is Registration.UNREGISTERED
        }
        monitor.report(Stage.SNAPSHOT, 0, 1)
        folder = self._folder.outcome(request.job_id)
        control = partial(self._control, request, monitor)
        return self._outcome(
            folder, views, images, model, cameras.points, final.sparse, measured, control=control
        )

    def _control(
        self, request: RunJob, monitor: Monitor, images: Mapping[str, Image], model: Path
    ) -> ControlOutcome | None:
        """The alignment of the COLMAP model in a folder by the scene's control points; None without any."""
        if request.control is None:
            return None
        stored = StoredImages(images, self._folder.images, self._blobs)
        return control_outcome(request.control, request.origin, stored, model, monitor)

    def _memory_to_train(self, scene: Scene, monitor: Monitor) -> AbstractContextManager[None]:
        need_bytes = training_bytes(scene.settings.training, scene.views)
        return self._memory.for_training(need_bytes, monitor)

    def _fine_folder(self, job_id: str) -> Path:
        """The folder of the job; those of earlier jobs are deleted."""
        folder = self._folder.fine(job_id)
        folder.mkdir(parents=True, exist_ok=True)
        for other in folder.parent.iterdir():
            if other != folder:
                shutil.rmtree(other)
        return folder

    @property
    def _growth(self) -> GrowthFolder:
        return GrowthFolder(SceneFiles(self._folder.growing).sfm)

    def _usual_side(self) -> int:
        """The image size that the scene's updates train with."""
        return read_choice(self._folder).long_side_px

    def _outcome(
        self,
        folder: Path,
        views: Sequence[TrainingView],
        images: Mapping[str, Image],
        model: SceneModel,
        points: PointCloud,
        colmap: Path,
        measured: Mapping[str, float | None],
        *,
        control: Callable[[Mapping[str, Image], Path], ControlOutcome | None],
        why_unregistered: Mapping[str, Finding] = MappingProxyType({}),
        compressed: bool = True,
    ) -> JobOutcome:
        """Write the artifacts, which the worker commits, into ``folder``.

        ``colmap`` is the folder of the model with ``views`` and ``points``; ``measured`` are metrics of the
        model's quality.
        """
        posed = {view.name for view in views}
        unregistered = {
            image.digest: why_unregistered.get(name) for name, image in images.items() if name not in posed
        }
        metrics = SnapshotMetrics(
            registered=len(views),
            unregistered=len(unregistered),
            points=len(points),
            iterations=model.iterations,
            gaussians=len(model.gaussians),
            sh_degree=model.sh_degree,
            **measured,
        )
        files = write_artifacts(folder, views, images, points, model, metrics, colmap, compressed=compressed)
        return JobOutcome(
            folder=str(folder),
            files=files,
            model_from_camera={images[view.name].digest: view.camera_from_model.inverse() for view in views},
            unregistered=unregistered,
            metrics=metrics,
            positions_ignored=self._growth.ignores_positions,
            control=control(images, colmap),
        )


def _quarantine(reasons: Mapping[str, Finding], monitor: Monitor, quarantine: Quarantine) -> None:
    """Name images in the job's warnings, then quarantine them: later starts do not use them."""
    for reason in reasons.values():
        monitor.warn(reason)
    if reasons:
        quarantine(reasons)


def _split(
    views: Sequence[TrainingView], test_every: int | None
) -> tuple[Sequence[TrainingView], Sequence[TrainingView]]:
    """The views to train on and the held-out views; none is held out when too few would be left."""
    trained, held_out = hold_out_views(views, test_every or 0)
    return (trained, held_out) if len(trained) >= 2 else (views, ())
