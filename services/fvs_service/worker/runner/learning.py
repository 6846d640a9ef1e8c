"""What a job does in the runner: cameras first, then the model, then the files of a snapshot."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.geometry import RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, split_test
from fvs_engine.scene.growing_scene import GrowingScene
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.settings import GROWING_TRAINING, SceneSettings
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import FocalPrior, SfmSettings
from fvs_engine.sfm.stages import fresh_folder
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.session import open_trainer, train_saving
from fvs_engine.splat.settings import PRESETS
from fvs_engine.splat.views import TrainingView
from fvs_service.images.model import Image, Registration
from fvs_service.jobs.model import JobKind, JobRequest
from fvs_service.scenes.model import CameraPrior
from fvs_service.settings import WorkerSettings
from fvs_service.snapshots.model import SnapshotMetrics
from fvs_service.storage.blobs import Blobs
from fvs_service.worker.protocol import JobOutcome, JobQuestion
from fvs_service.worker.runner.model_files import write_model_files
from fvs_service.worker.runner.pace import JobMonitor
from fvs_service.worker.runner.photographs import place_photographs
from fvs_service.worker.runner.quality import Quality, measure, spread
from fvs_service.worker.runner.states import States
from fvs_service.worker.runner.told_positions import told_positions

_SAVE_EVERY_S = 30.0
_MOST_MEASURED = 16
"""New photographs that the snapshot before is measured on: an update must not wait for its own praise."""

Warn = Callable[[str], None]


class SceneChoice(BaseModel):
    """How the scene learns: chosen by its first update, kept for its life."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    long_side_px: int
    initial_iterations: int
    iterations_per_image: int
    max_gaussians: int


@dataclass(frozen=True)
class SceneFolder:
    """What a scene keeps on the worker's disk."""

    root: Path

    @property
    def images(self) -> Path:
        """The photographs that were taken up."""
        return self.root / "images"

    @property
    def growing(self) -> Path:
        """The growing scene's own folder."""
        return self.root / "growing"

    @property
    def choice(self) -> Path:
        """The ``SceneChoice``."""
        return self.root / "choice.json"

    def fine(self, job_id: str) -> Path:
        """What a fine model goes on from: its cameras and its checkpoint."""
        return self.root / "fine" / job_id

    def outcome(self, job_id: str) -> Path:
        """Where a job leaves the files of its snapshot."""
        return self.root / "outcome" / job_id


@dataclass(frozen=True, eq=False)
class _Model:
    """What was learnt."""

    gaussians: Gaussians
    sh_degree: int
    iterations: int


class Learner:
    """Does a scene's jobs, one at a time; keeps the growing scene warm between them."""

    def __init__(
        self, folder: Path, blobs: Blobs, settings: WorkerSettings, rasterizer: Rasterizer, states: States
    ) -> None:
        self._folder = SceneFolder(folder)
        self._blobs = blobs
        self._settings = settings
        self._rasterizer = rasterizer
        self._states = states
        self._scene: GrowingScene | None = None
        self._learned = 0  # iterations of the model that the update found

    def run(self, question: JobQuestion, monitor: JobMonitor, warn: Warn) -> JobOutcome:
        """Do the job; a repeated call goes on where the last one stopped. Raises ``EngineError``."""
        try:
            if question.request.kind is JobKind.UPDATE:
                return self._update(question, monitor, warn)
            return self._fine(question, monitor)
        except BaseException:
            self._scene = None  # what is in memory may be ahead of, or beside, what is on disk
            raise
        finally:
            self._states.forget_live()

    def on_step(self, question: JobQuestion, iteration: int) -> None:
        """Let rankings use the model while an update trains it, whenever it is fit to be looked at.

        Shortly after Gaussians were split a model renders worse; the schedule puts these moments half-way
        between those at which it is published. One that began anew is no better than its predecessor before
        it has learned as long.
        """
        scene = self._scene
        updating = question.request.kind is JobKind.UPDATE
        if not updating or question.snapshot_id is None or scene is None:
            return
        every = scene.settings.iterations_per_view
        if iteration >= self._learned and (iteration - scene.settings.initial_iterations) % every == 0:
            self._states.publish(question.snapshot_id, scene.gaussians, scene.sh_degree, iteration)

    def _update(self, question: JobQuestion, monitor: JobMonitor, warn: Warn) -> JobOutcome:
        images = self._photographs(question, monitor)
        if len(images) < 2:
            raise ReconstructionError(
                f"The scene has {len(images)} usable photographs, and a model needs two or more.",
                hint="Send more photographs that overlap; eight or more make a good start.",
            )
        scene = self._open_scene(question, monitor, warn)
        self._learned = scene.iteration
        update = scene.add(tuple(images), monitor, told_positions(images, question.origin))
        foresight = self._foresight(question, scene, images, monitor)
        for sentence in update.warnings:
            warn(sentence)
        if update.registered or update.moved:
            scene.save()
        scene.train(monitor)
        scene.save()
        assert scene.model_dir is not None  # training needs views, whose poses are those of this model
        model = _Model(scene.gaussians, scene.sh_degree, scene.iteration)
        measured = {"new_images_psnr_db": None if foresight is None else foresight.psnr_db}
        return self._outcome(question, scene.views, images, model, scene.model_dir, measured, monitor)

    def _foresight(
        self, question: JobQuestion, scene: GrowingScene, images: Mapping[str, Image], monitor: Monitor
    ) -> Quality | None:
        """How well the latest snapshot shows the photographs that came since, before they are learned."""
        if question.snapshot_id is None:
            return None
        before = self._states.exactly(question.snapshot_id)
        seen = {view.image for view in before.cameras.views}
        new = [view for view in scene.views if images[view.name].digest not in seen]
        views = spread(new, _MOST_MEASURED)
        return measure(before.gaussians, before.sh_degree, views, self._rasterizer, monitor)

    def _photographs(self, question: JobQuestion, monitor: Monitor) -> Mapping[str, Image]:
        return place_photographs(self._blobs, question.images, self._folder.images, monitor)

    def _open_scene(self, question: JobQuestion, monitor: Monitor, warn: Warn) -> GrowingScene:
        choice = self._choose(question.request, warn)
        if self._scene is None:
            self._scene = GrowingScene.open(
                self._folder.growing,
                Dataset("scene", self._folder.images, (), arriving=True),
                SceneSettings(
                    long_side_px=choice.long_side_px,
                    initial_iterations=choice.initial_iterations,
                    iterations_per_view=choice.iterations_per_image,
                    training=GROWING_TRAINING.model_copy(update={"max_gaussians": choice.max_gaussians}),
                    sfm=self._sfm(question.camera),
                ),
                self._rasterizer,
                monitor,
            )
        return self._scene

    def _choose(self, request: JobRequest, warn: Warn) -> SceneChoice:
        """What the first update chose; of a later one's wishes it is told that they come too late."""
        try:
            kept = SceneChoice.model_validate_json(self._folder.choice.read_text(encoding="utf-8"))
        except FileNotFoundError:
            settings = self._settings
            kept = SceneChoice(
                long_side_px=request.long_side_px or settings.long_side_px,
                initial_iterations=request.iterations or settings.initial_iterations,
                iterations_per_image=settings.iterations_per_image,
                max_gaussians=settings.max_gaussians,
            )
            write_text_atomically(self._folder.choice, kept.model_dump_json(indent=1))
        for name, wanted, used in (
            ("long_side_px", request.long_side_px, kept.long_side_px),
            ("iterations", request.iterations, kept.initial_iterations),
        ):
            if wanted is not None and wanted != used:
                warn(f"{name} stays {used}, which the scene's first update chose.")
        return kept

    def _fine(self, question: JobQuestion, monitor: JobMonitor) -> JobOutcome:
        placed = self._photographs(question, monitor)
        fine = self._fine_folder(question.job_id)
        standing = self._cameras_of(fine, question.camera, monitor)
        request, settings = question.request, self._settings
        photographs = Photographs(self._folder.images, request.long_side_px or self._usual_side())
        views = []
        for done, view in enumerate(standing.views, start=1):
            monitor.check()
            views.append(photographs.load(view.name, view.camera, view.camera_from_model))
            monitor.report("load", done, len(standing.views))
        learned, tested = _split(views, request.test_every)
        training = PRESETS["fine"].model_copy(update={"max_gaussians": settings.fine_max_gaussians})
        training = training.with_iterations(request.iterations or settings.fine_iterations)
        checkpoint = fine / "checkpoint.safetensors"
        trainer = open_trainer(
            checkpoint,
            learned,
            training,
            lambda: initialise_from_points(standing.points.xyz, standing.points.colors, training.sh_degree),
            self._rasterizer,
        )
        train_saving(trainer, training.iterations, monitor, lambda: trainer.save(checkpoint), _SAVE_EVERY_S)
        trainer.save(checkpoint)
        model = _Model(trainer.gaussians, trainer.sh_degree, trainer.iteration)
        quality = measure(model.gaussians, model.sh_degree, tested, self._rasterizer, monitor)
        measured = {} if quality is None else asdict(quality)
        # Images that arrived after the model's update are neither registered nor unregistered yet.
        posed = {view.name for view in views}
        images = {
            name: image
            for name, image in placed.items()
            if name in posed or image.registration is Registration.UNREGISTERED
        }
        return self._outcome(question, views, images, model, fine / "sparse", measured, monitor)

    def _fine_folder(self, job_id: str) -> Path:
        """What the job keeps; what jobs before it kept is deleted."""
        folder = self._folder.fine(job_id)
        folder.mkdir(parents=True, exist_ok=True)
        for other in folder.parent.iterdir():
            if other != folder:
                shutil.rmtree(other)
        return folder

    def _cameras_of(self, fine: Path, camera: CameraPrior | None, monitor: Monitor) -> Reconstruction:
        """The cameras that the fine model is trained with, also if updates find others meanwhile."""
        kept = fine / "sparse"
        if not kept.exists():
            reconstruction = GrowingReconstruction.open(
                self._folder.growing / "sfm", self._folder.images, self._sfm(camera), monitor
            )
            model_dir = reconstruction.model_dir
            if model_dir is None:
                raise InvalidInputError("The scene has no cameras yet.", hint="Run an update first.")
            partial = fresh_folder(fine / "sparse.partial")
            shutil.copytree(model_dir, partial, dirs_exist_ok=True)
            partial.rename(kept)
        return read_colmap(kept)

    def _usual_side(self) -> int:
        """The size that the scene's updates learn from."""
        choice = SceneChoice.model_validate_json(self._folder.choice.read_text(encoding="utf-8"))
        return choice.long_side_px

    def _sfm(self, camera: CameraPrior | None) -> SfmSettings:
        prior = None if camera is None else FocalPrior.model_validate(camera.model_dump())
        return SfmSettings(threads=self._settings.threads, focal_prior=prior)

    def _outcome(
        self,
        question: JobQuestion,
        views: Sequence[TrainingView],
        images: Mapping[str, Image],
        model: _Model,
        colmap: Path,
        measured: Mapping[str, float | None],
        monitor: Monitor,
    ) -> JobOutcome:
        """Write the snapshot's files, which the worker commits; ``measured`` are metrics of its quality."""
        monitor.report("snapshot", 0, 1)
        standing = read_colmap(colmap)
        posed = {view.name for view in views}
        unregistered = tuple(image.digest for name, image in images.items() if name not in posed)
        metrics = SnapshotMetrics(
            registered=len(views),
            unregistered=len(unregistered),
            points=len(standing.points),
            iterations=model.iterations,
            gaussians=len(model.gaussians),
            sh_degree=model.sh_degree,
            **measured,
        )
        folder = self._folder.outcome(question.job_id)
        points = _seen_points(standing)
        files = write_model_files(folder, views, images, points, model.gaussians, metrics, colmap)
        return JobOutcome(
            folder=str(folder),
            files=files,
            model_from_camera={
                images[view.name].digest: _rows(view.camera_from_model.inverse()) for view in views
            },
            unregistered=unregistered,
            metrics=metrics,
        )


def _split(
    views: Sequence[TrainingView], test_every: int | None
) -> tuple[Sequence[TrainingView], Sequence[TrainingView]]:
    """The views to learn from, and those to measure by; all are learned from when too few could be spared."""
    learned, tested = split_test([view.name for view in views], test_every or 0)
    if len(learned) < 2:
        return views, ()
    named = {view.name: view for view in views}
    return [named[name] for name in learned], [named[name] for name in tested]


def _seen_points(reconstruction: Reconstruction) -> NDArray[np.float64]:
    """The sparse points; where there are none, as in a model that began from guesses, the cameras."""
    if len(reconstruction.points):
        return reconstruction.points.xyz
    return np.stack([view.centre for view in reconstruction.views])


def _rows(transform: RigidTransform) -> tuple[tuple[float, float, float, float], ...]:
    """A transform as a matrix [3, 4]."""
    return tuple((row[0], row[1], row[2], row[3]) for row in transform.matrix[:3].tolist())
