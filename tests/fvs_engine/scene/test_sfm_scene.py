from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.geometry import robust_umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings
from fvs_engine.splat.raster import Rasterizer

pytestmark = pytest.mark.usefixtures("all_native_here")


@pytest.mark.system
def test_a_scene_whose_cameras_are_found_on_the_way(
    tmp_path: Path,
    yard_dir: Path,
    quick_settings: Callable[..., SceneSettings],
    cpu: Rasterizer,
) -> None:
    """Killed after structure from motion committed a photograph, and before the scene was saved with it."""
    dataset = open_dataset(yard_dir)
    settings = quick_settings(
        poses="sfm",
        long_side_px=96,
        sfm=SfmSettings(threads=1, features_of_few=FeatureSettings(max_features=2000)),
    )

    def opened() -> Scene:
        return Scene.open(tmp_path / "scene", dataset, settings, cpu, Monitor())

    first, later, never = dataset.names[:4], dataset.names[4], dataset.names[5]
    scene = opened()
    update = scene.add(first, Monitor())
    assert update.registered == first
    assert update.warnings == ()  # a hundred points or more
    scene.save()
    assert scene.model_dir is not None
    in_model = read_colmap(scene.model_dir).points.xyz
    assert np.array_equal(scene.points.xyz, in_model)  # points of two views are none of the scene's
    before = {view.name: view.camera_from_model.matrix for view in scene.views}
    scene.add([later], Monitor())

    resumed = opened()
    assert resumed.visited == first
    assert np.array_equal(resumed.points.xyz, in_model)
    assert {view.name: view.camera_from_model.matrix.tolist() for view in resumed.views} == {
        name: matrix.tolist() for name, matrix in before.items()
    }
    resumed.add([later], Monitor())
    found = resumed.train("quick", Monitor())
    expected = scene.train("quick", Monitor())
    for name, tensor in expected.gaussians.tensors().items():
        assert torch.equal(tensor, found.gaussians.tensors()[name]), name

    world = dataset.centres()
    fit = robust_umeyama(
        np.stack([world[view.name] for view in scene.views]), np.stack([view.centre for view in scene.views])
    )
    spread = np.std([view.centre for view in scene.views], axis=0).max()
    assert fit.rms < 0.05 * spread
    placed = scene.localise([never], Monitor())
    assert len(scene.views) == len(resumed.views)
    assert never not in scene.visited
    assert placed[never].image.shape == (72, 96, 3)
    assert np.linalg.norm(placed[never].centre - fit.transform.apply(world[never])) < 0.1 * spread
