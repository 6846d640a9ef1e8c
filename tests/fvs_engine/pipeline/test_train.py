"""Training in an output folder: what a finished model of quality ``fine`` has."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from floating import with_one_before
from georeferenced_folder import GeoreferencedFolder
from PIL import Image

from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import Manifest, ReconstructionSettings
from fvs_engine.pipeline.model import model_views, open_model, read_undistorted
from fvs_engine.pipeline.train import train, training_settings
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.scene.final_model import FinalModel
from fvs_engine.scene.photographs import Photographs
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.settings import TrainingSettings
from fvs_engine.splat.trainer import Trainer, read_gaussians
from fvs_engine.splat.views import TrainingView

SIDE_PX = 64


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """An output folder whose photographs are grey, and which has not been trained."""
    made = GeoreferencedFolder(tmp_path / "folder", GeodeticPosition(50.82, -0.14, 80.0))
    workspace = Workspace(made.root)
    workspace.undistorted_images.mkdir(parents=True)
    for name in made.cameras:
        Image.new("RGB", (400, 300), (90, 90, 90)).save(workspace.undistorted_images / name)
    return workspace


def _loaded(workspace: Workspace) -> list[TrainingView]:
    views = model_views(read_undistorted(workspace), SIDE_PX)
    return Photographs(workspace.undistorted_images, SIDE_PX).load_all(views, Monitor())


def _start(workspace: Workspace, settings: TrainingSettings, checkpoint: Path) -> None:
    """Write a checkpoint of a model with a floater: a training goes on from there."""
    views, points = _loaded(workspace), read_undistorted(workspace).points
    ground = initialise_from_points(points.xyz, points.colors, settings.sh_degree)
    gaussians = with_one_before(views[0], 0.1, ground)
    Trainer(views, gaussians, settings, create_rasterizer("cpu")).save(checkpoint)


@pytest.mark.parametrize(("quality", "left"), [("coarse", 201), ("fine", 200)])
def test_a_fine_model_has_no_floaters_and_its_checkpoint_keeps_them(
    workspace: Workspace, quality: str, left: int
) -> None:
    before = workspace.read_manifest()
    assert before is not None
    settings = ReconstructionSettings.model_validate(
        {"quality": quality, "iterations": 1, "long_side_px": SIDE_PX, "test_every": 0}
    )
    manifest: Manifest = before.model_copy(update={"settings": settings, "training": None})
    _start(workspace, training_settings(settings), workspace.checkpoint)
    metrics = train(workspace, manifest, monitor=Monitor())
    after = workspace.read_manifest()
    assert after is not None
    assert after.training is not None
    assert metrics.gaussians == after.training.gaussians == len(read_ply(workspace.point_cloud)) == left
    assert len(read_gaussians(workspace.checkpoint)[0]) == 201


def test_a_model_knows_what_share_of_its_masked_views_counts(workspace: Workspace) -> None:
    before = workspace.read_manifest()
    assert before is not None
    (workspace.undistorted / "masks").mkdir()
    name = sorted(file.name for file in workspace.undistorted_images.iterdir())[0]
    mask = np.tile(np.arange(400) < 100, (300, 1))
    Image.fromarray(mask).save(workspace.undistorted / "masks" / f"{name}.png")
    settings = ReconstructionSettings(quality="coarse", iterations=1, long_side_px=SIDE_PX, test_every=0)
    train(workspace, before.model_copy(update={"settings": settings, "training": None}), monitor=Monitor())
    shares = {view.name: view.counted_share for view in open_model(workspace.root).views}
    assert shares.pop(name) == pytest.approx(0.25)
    assert shares
    assert set(shares.values()) == {1.0}


def test_a_final_model_of_the_service_has_no_floaters(workspace: Workspace, tmp_path: Path) -> None:
    settings = TrainingSettings(iterations=1, sh_degree=0)
    _start(workspace, settings, tmp_path / "checkpoint.safetensors")
    points = read_undistorted(workspace).points
    masked = [replace(view, mask=np.ones(view.image.shape[:2], bool)) for view in _loaded(workspace)]
    model = FinalModel(tmp_path).train(masked, points, settings, create_rasterizer("cpu"), Monitor())
    assert len(model.gaussians) == 200
