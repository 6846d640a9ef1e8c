"""The final model of a scene: trained on cameras that later updates do not change."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.sfm.batch.mapping import leave_out, registered_names
from fvs_engine.sfm.colmap.model import open_colmap, read_colmap
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.sfm.stages import fresh_folder
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.session import open_trainer, train_saving
from fvs_engine.splat.settings import TrainingSettings
from fvs_engine.splat.views import TrainingView


@dataclass(frozen=True)
class FinalModel:
    """A final model in a ``folder`` of its own: its cameras in ``sparse/``, and the checkpoint."""

    folder: Path

    @property
    def sparse(self) -> Path:
        """The COLMAP model of its cameras."""
        return self.folder / "sparse"

    def cameras(self, current_model: Path | None, images: Collection[str]) -> Reconstruction:
        """Those of the scene's ``current_model`` at the first call, and the same ones at later calls.

        When one of the ``images`` has been left out since, the training starts again without it. Raises
        ``InvalidInputError`` when there is no model.
        """
        if self.sparse.exists() and any(view.name not in images for view in read_colmap(self.sparse).views):
            fresh_folder(self.folder)
        if not self.sparse.exists():
            if current_model is None:
                raise InvalidInputError("The scene has no cameras yet.", hint="Run an update first.")
            partial = fresh_folder(self.folder / "sparse.partial")
            model = open_colmap(current_model)
            leave_out(model, [name for name in registered_names(model) if name not in images])
            model.write_binary(partial)
            partial.rename(self.sparse)
        return read_colmap(self.sparse)

    def train(
        self,
        views: Sequence[TrainingView],
        points: PointCloud,
        settings: TrainingSettings,
        rasterizer: Rasterizer,
        monitor: Monitor,
    ) -> SceneModel:
        """Train on ``views`` from their ``points``; resumes from the checkpoint, which is saved every minute.

        The model is without floaters, which the checkpoint keeps. Raises ``Cancelled``, having saved, and
        ``TrainingError``.
        """
        checkpoint = self.folder / "checkpoint.safetensors"
        trainer = open_trainer(checkpoint, views, (points.xyz, points.colors), settings, rasterizer)
        train_saving(trainer, settings.iterations, monitor, lambda: trainer.save(checkpoint))
        trainer.save(checkpoint)
        return SceneModel.of(trainer).without_floaters(views, points, rasterizer, monitor)
