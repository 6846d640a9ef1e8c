"""Scenes: a dataset's images, the views visited so far, and the Gaussians trained on them."""

from fvs_engine.scene.dataset import Dataset, read_dataset
from fvs_engine.scene.scene import Scene, SceneUpdate
from fvs_engine.scene.settings import SceneSettings

__all__ = [
    "Dataset",
    "Scene",
    "SceneSettings",
    "SceneUpdate",
    "read_dataset",
]
