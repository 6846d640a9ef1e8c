"""The two models of a scene: trained on its present views, kept in its folder."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from fvs_engine.errors import StorageError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.familiarity import Observations
from fvs_engine.records import Record
from fvs_engine.scene.scene_files import SceneFiles
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.seeding import initial_seeds
from fvs_engine.scene.settings import ModelQuality, SceneSettings
from fvs_engine.scene.warm_start import WarmStart
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.checkpoint import read_checkpoint_state
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.session import train_saving
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import AnyView, PinholeView, with_share
from fvs_schema.stages import Stage

STAGES: Mapping[ModelQuality, Stage] = {"quick": Stage.QUICK_TRAINING, "full": Stage.TRAINING}
"""The stage in which each model is trained."""


class _Owner(Record):
    """Owner of a checkpoint: the model's quality, its views, and the digest of its inputs."""

    digest: str
    quality: ModelQuality
    views: tuple[PinholeView, ...]

    def is_of_the_model(self, other: "_Owner") -> bool:
        return (self.digest, self.quality) == (other.digest, other.quality)


class SceneModels:
    """The models of the present views. Training repeated after a kill gives the same bits."""

    def __init__(
        self,
        files: SceneFiles,
        settings: SceneSettings,
        rasterizer: Rasterizer,
        read_observations: Callable[[], Observations | None],
    ) -> None:
        self._files = files
        self._settings = settings
        self._rasterizer = rasterizer
        self._read_observations = read_observations
        self._views: tuple[TrainingView, ...] = ()
        self._points = PointCloud.empty()
        self._digest = ""  # of what a model depends on, beside the settings
        self._trained: dict[ModelQuality, SceneModel] = {}

    def follow(
        self, posed: Mapping[str, AnyView], views: tuple[TrainingView, ...], points: PointCloud
    ) -> None:
        """Replace the views, in the order of their names, and their points; forget models of other views.

        ``posed`` are the same views by name, with distortion.
        """
        self._views, self._points = views, points
        digest = _digest(posed, views, points)
        if digest != self._digest:
            self._digest, self._trained = digest, {}

    def is_trained(self, quality: ModelQuality) -> bool:
        """Whether there is a finished model of the present views."""
        if quality in self._trained:
            return True
        owner = _owner(self._files.model(quality))
        return owner is not None and owner.digest == self._digest

    def train(self, quality: ModelQuality, monitor: Monitor) -> SceneModel:
        """The model of the present views; raises ``Cancelled``, having saved, and ``TrainingError``."""
        if quality not in self._trained:
            if self.is_trained(quality):
                model = SceneModel.read(self._files.model(quality), self._rasterizer.device)
            else:
                model = self._train(quality, monitor)
            self._trained[quality] = replace(
                model, views=self._poses, read_observations=self._read_observations
            )
        return self._trained[quality]

    def train_again(self, seed: int, monitor: Monitor) -> SceneModel:
        """Train a full model of the present views with another seed; not stored. Raises as ``train``."""
        iterations = self._settings.iterations_of("full", len(self._views))
        trainer = self.initial_trainer("full", iterations, seed)
        trainer.train(iterations, monitor, STAGES["full"])
        return SceneModel.of(trainer)

    @property
    def _poses(self) -> tuple[PinholeView, ...]:
        """The views without their images."""
        return tuple(with_share(view, view.counted_share) for view in self._views)

    def initial_trainer(self, quality: ModelQuality, iterations: int, seed: int) -> Trainer:
        """The trainer of a new model, with Gaussians on the sparse points."""
        training = self._settings.training_of(quality, iterations)
        seeds = initial_seeds(self._points, self._views, training.max_gaussians, seed)
        return Trainer(self._views, seeds.gaussians(training.sh_degree), training, self._rasterizer, seed)

    def _train(self, quality: ModelQuality, monitor: Monitor) -> SceneModel:
        """Train a model, or finish the one in training."""
        owner = _Owner(digest=self._digest, quality=quality, views=self._poses)
        trainer, iterations = self._trainer(owner)

        def save(path: Path = self._files.training) -> None:
            trainer.save(path, owner_state=owner.model_dump(mode="json"))

        train_saving(trainer, iterations, monitor, save, STAGES[quality])
        save(self._files.model(quality))
        self._files.training.unlink(missing_ok=True)
        return SceneModel.of(trainer)

    def _trainer(self, owner: _Owner) -> tuple[Trainer, int]:
        """The trainer of a model, and the iteration until which it trains."""
        warm = self._warm_start() if owner.quality == "quick" else None
        until = self._settings.iterations_of(owner.quality, len(self._views))
        if warm is not None:
            until = warm.until_iteration
        unfinished = _owner(self._files.training)
        if unfinished is not None and unfinished.is_of_the_model(owner):
            return Trainer.resume(self._files.training, self._views, self._rasterizer), until
        if warm is not None:
            return warm.trainer(self._views, self._settings, self._rasterizer), until
        return self.initial_trainer(owner.quality, until, self._settings.seed), until

    def _warm_start(self) -> WarmStart | None:
        """The warm start of a quick model from the last full one; None if it is better trained anew."""
        full = self._files.model("full")
        owner = _owner(full) if self._settings.warm_starts else None
        if owner is None:
            return None
        return WarmStart.of(
            SceneModel.read(full, self._rasterizer.device), owner.views, self._views, self._points
        )


def _owner(checkpoint: Path) -> _Owner | None:
    """The owner of a checkpoint; None without a checkpoint."""
    if not checkpoint.exists():
        return None
    try:
        return _Owner.model_validate(read_checkpoint_state(checkpoint)["owner"])
    except (KeyError, ValidationError) as error:
        raise StorageError(
            f"{checkpoint} is not of a scene: {error}", hint="Delete it and train again.", path=checkpoint
        ) from error


def _digest(posed: Mapping[str, AnyView], views: Sequence[TrainingView], points: PointCloud) -> str:
    digest = hashlib.sha256()
    for name, view in posed.items():
        digest.update(f"{name}\0{view.camera}\0".encode())
        digest.update(np.ascontiguousarray(view.camera_from_model.matrix).tobytes())
    for masked in views:
        if masked.mask is not None:
            digest.update(f"{masked.name}\0mask\0".encode() + np.packbits(masked.mask).tobytes())
    digest.update(np.ascontiguousarray(points.xyz).tobytes())
    digest.update(np.ascontiguousarray(points.colors).tobytes())
    return digest.hexdigest()
