"""Scenes that grow: a dataset's photographs, the views visited so far, and the Gaussians learnt from them."""

from fvs_engine.scene.dataset import Dataset, read_dataset, split_test
from fvs_engine.scene.growing_scene import GrowingScene, SceneUpdate
from fvs_engine.scene.settings import SceneSettings

__all__ = [
    "Dataset",
    "GrowingScene",
    "SceneSettings",
    "SceneUpdate",
    "read_dataset",
    "split_test",
]
