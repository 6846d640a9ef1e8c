"""The trained model of an output folder: the Gaussians and the views they were trained on."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.pipeline.manifest import Manifest, TrainingRecord
from fvs_engine.pipeline.views import model_views, read_undistorted, usual_camera
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.observations import read_observations
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply
from fvs_engine.views import PinholeView


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """A trained model with its views; ``aliases`` are the views' names in the source folder."""

    workspace: Workspace
    manifest: Manifest
    training: TrainingRecord
    gaussians: Gaussians
    views: tuple[PinholeView, ...]

    @property
    def aliases(self) -> Mapping[str, str]:
        """A photograph's name in the source folder → its name in the model."""
        return {record.name: record.normalised_name for record in self.manifest.images.photographs}

    @property
    def training_views(self) -> tuple[PinholeView, ...]:
        """The views that the Gaussians were trained on."""
        return tuple(view for view in self.views if view.name in self.training.train_views)

    @property
    def held_out_views(self) -> tuple[PinholeView, ...]:
        """The views that were not trained on."""
        return tuple(view for view in self.views if view.name in self.training.test_views)

    @cached_property
    def observations(self) -> Observations | None:
        """The sparse points and who saw them; None where the poses of photographs are given."""
        cameras = self.manifest.cameras
        if cameras is None or cameras.source != "photographs":
            return None
        return read_observations(self.workspace.undistorted / "sparse")

    @property
    def camera(self) -> PinholeCamera:
        """The camera that most training views have."""
        return usual_camera(self.training_views)


def open_model(root: Path) -> TrainedModel:
    """Read the last good state of an output folder, also during a training in it.

    Raises ``InvalidInputError`` when it is not an output folder or has no trained model yet.
    """
    workspace = Workspace.existing(root)
    manifest = workspace.read_manifest()
    if manifest is None or manifest.training is None:
        raise InvalidInputError(
            f"{root} holds no trained model yet.", hint="Run the same `fvs reconstruct` again to go on."
        )
    views = model_views(read_undistorted(workspace), manifest.settings.training_long_side_px)
    return TrainedModel(workspace, manifest, manifest.training, read_ply(workspace.point_cloud), views)
