"""The files in a scene's folder.

scene.json           identity: dataset and settings
state.safetensors    what the models depend on: visits, views and their sparse points
quick.safetensors    the last quick model; it names the state that it belongs to
full.safetensors     the last full model, likewise
training.safetensors the model in training, likewise
sfm/                 features, matches, and the growing reconstruction
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from fvs_engine.errors import InvalidInputError, OtherSettingsError, StorageError
from fvs_engine.files.owned_folder import OwnedFolder, differences
from fvs_engine.files.storage import storage_errors
from fvs_engine.records import Record
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import ModelQuality, SceneSettings
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.checkpoint import read_checkpoint, write_checkpoint
from fvs_engine.views import AnyView


class SceneIdentity(Record):
    """``scene.json``: the dataset, by a digest of its views, and the settings."""

    dataset: str
    settings: dict[str, Any]


class SceneState(Record):
    """``state.safetensors``, beside the sparse points: the visits and the poses of the registered images."""

    visited: tuple[str, ...]
    views: tuple[AnyView, ...]
    generation: int
    two_view_points: int = 0
    """Number of the points that only two images show: the last ones."""


@dataclass(frozen=True)
class SceneFiles:
    """The paths in a scene's folder."""

    root: Path

    @property
    def identity(self) -> Path:
        """The dataset and settings of the folder."""
        return self.root / "scene.json"

    @property
    def state(self) -> Path:
        """The state of the last save."""
        return self.root / "state.safetensors"

    def model(self, quality: ModelQuality) -> Path:
        """The checkpoint of a finished model."""
        return self.root / f"{quality}.safetensors"

    @property
    def training(self) -> Path:
        """The checkpoint of the model in training."""
        return self.root / "training.safetensors"

    @property
    def sfm(self) -> Path:
        """The files of structure from motion."""
        return self.root / "sfm"

    def claim(self, dataset: Dataset, settings: SceneSettings) -> None:
        """Create the folder for this dataset and these settings, or check that it belongs to them.

        The number of threads of structure from motion may change. Raises ``OtherSettingsError`` when the
        folder is of this dataset with other settings, ``InvalidInputError`` when it is of another one,
        ``StorageError`` when it cannot be used.
        """
        given = SceneIdentity(
            dataset=_fingerprint(dataset),
            settings=settings.model_dump(mode="json", exclude={"sfm": {"threads"}}),
        )
        owned = OwnedFolder(self.root, self.identity.name, SceneIdentity, "scene")
        earlier = owned.read()
        if earlier is None:
            with storage_errors(self.root):
                self.root.mkdir(parents=True, exist_ok=True)
            owned.write(given)
            return
        found = differences(earlier.settings, given.settings)
        if earlier.dataset != given.dataset:
            owned.require_same(["it is of another dataset", *found], InvalidInputError)
        owned.require_same(found, OtherSettingsError)

    def write_state(self, state: SceneState, points: PointCloud) -> None:
        """Replace the state; atomic. Raises ``StorageError``."""
        tensors = {"xyz": torch.from_numpy(points.xyz), "colors": torch.from_numpy(points.colors)}
        write_checkpoint(self.state, tensors, state.model_dump(mode="json"))

    def read_state(self) -> tuple[SceneState, PointCloud] | None:
        """The state of the last save, None before the first; raises ``StorageError``."""
        if not self.state.exists():
            return None
        tensors, document = read_checkpoint(self.state)
        try:
            state = SceneState.model_validate(document)
            return state, PointCloud(tensors["xyz"].numpy(), tensors["colors"].numpy())
        except (KeyError, ValidationError) as error:
            raise StorageError(
                f"{self.state} is not the state of a scene.",
                hint="Delete the folder and start again.",
                path=self.state,
            ) from error


def _fingerprint(dataset: Dataset) -> str:
    """A digest of the views: names, cameras and poses."""
    digest = hashlib.sha256()
    for view in dataset.views:
        digest.update(f"{view.name}\0{view.camera}\0".encode())
        digest.update(np.ascontiguousarray(view.camera_from_model.matrix).tobytes())
    return digest.hexdigest()
