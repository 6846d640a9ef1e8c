"""The files in a growing scene's folder.

scene.json               identity: dataset and settings
checkpoint.safetensors   the whole state: Gaussians, optimiser, views, visits (in one file, so consistent)
sfm/                     features, matches, and the growing reconstruction
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from fvs_engine.errors import InvalidInputError, StorageError
from fvs_engine.files.owned_folder import OwnedFolder, differences
from fvs_engine.files.storage import storage_errors
from fvs_engine.records import Record
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.views import AnyView


class SceneIdentity(Record):
    """``scene.json``: the dataset, by a digest of its views, and the settings."""

    dataset: str
    settings: dict[str, Any]


class SceneState(Record):
    """A scene's state beside its trainer's, in the same checkpoint."""

    visited: tuple[str, ...]
    views: tuple[AnyView, ...]
    initial_views: int
    points_at_start: int
    """Sparse points that the views shared when the model last started."""
    generation: int


@dataclass(frozen=True)
class SceneFiles:
    """The paths in a scene's folder."""

    root: Path

    @property
    def identity(self) -> Path:
        """The dataset and settings of the folder."""
        return self.root / "scene.json"

    @property
    def checkpoint(self) -> Path:
        """The state of the last save."""
        return self.root / "checkpoint.safetensors"

    @property
    def sfm(self) -> Path:
        """The files of structure from motion."""
        return self.root / "sfm"

    def claim(self, dataset: Dataset, settings: SceneSettings) -> None:
        """Create the folder for this dataset and these settings, or check that it belongs to them.

        The number of threads of structure from motion may change. Raises ``InvalidInputError`` when the
        folder belongs to others, ``StorageError`` when it cannot be used.
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
            found.insert(0, "it is of another dataset")
        owned.require_same(found, InvalidInputError)

    def state(self, document: Any) -> SceneState:
        """The scene's part of a checkpoint's state; raises ``StorageError`` when there is none."""
        try:
            return SceneState.model_validate(document["owner"])
        except (KeyError, ValidationError) as error:
            raise StorageError(
                f"{self.checkpoint} is not the checkpoint of a scene.",
                hint="Delete the folder and start again.",
            ) from error


def _fingerprint(dataset: Dataset) -> str:
    """A digest of the views: names, cameras and poses."""
    digest = hashlib.sha256()
    for view in dataset.views:
        digest.update(f"{view.name}\0{view.camera}\0".encode())
        digest.update(np.ascontiguousarray(view.camera_from_model.matrix).tobytes())
    return digest.hexdigest()
