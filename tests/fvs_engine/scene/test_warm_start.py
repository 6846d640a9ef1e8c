"""Quick models that go on from a full one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.errors import Cancelled
from fvs_engine.geometry import RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.scene.warm_start import WarmStart
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.views import TrainingView

Settings = Callable[..., SceneSettings]
FIRST = ("0.png", "1.png", "2.png", "8.png", "9.png", "4.png")


@pytest.fixture
def opened(tmp_path: Path, ball: Dataset, quick_settings: Settings, cpu: Rasterizer) -> Callable[..., Scene]:
    """Opens the scene in a folder; keywords change its settings."""

    def open_scene(folder: str = "scene", **changes: object) -> Scene:
        settings = quick_settings(**{"initial_iterations": 60, "warm_starts": True, **changes})
        return Scene.open(tmp_path / folder, ball, settings, cpu, Monitor())

    return open_scene


def went_on(model: SceneModel, full: SceneModel) -> bool:
    return model.iterations > full.iterations


def quality_db(model: SceneModel, views: Sequence[TrainingView], cpu: Rasterizer) -> float:
    with torch.no_grad():
        colors = [cpu.render(model.gaussians, view.camera, view.camera_from_model).color for view in views]
    return float(
        np.mean(
            [
                psnr(color.clamp(0, 1).numpy(), view.image / 255)
                for color, view in zip(colors, views, strict=True)
            ]
        )
    )


def test_a_quick_model_goes_on_from_the_last_full_one_and_learns_the_new_view(
    opened: Callable[..., Scene], cpu: Rasterizer
) -> None:
    scene, anew = opened(), opened("anew", warm_starts=False)
    for grown in (scene, anew):
        grown.add(FIRST, Monitor())
    full = scene.train("full", Monitor())
    before = {name: tensor.clone() for name, tensor in full.gaussians.tensors().items()}
    for grown in (scene, anew):
        grown.add(["5.png"], Monitor())
    warm, cold = (grown.train("quick", Monitor()) for grown in (scene, anew))
    assert warm.iterations == full.iterations + 14
    assert not went_on(cold, full)
    assert all(torch.equal(before[name], tensor) for name, tensor in full.gaussians.tensors().items())
    new = [view for view in scene.views if view.name == "5.png"]
    assert quality_db(warm, new, cpu) > quality_db(full, new, cpu) + 0.5  # measured: 0.74
    assert quality_db(warm, scene.views, cpu) > quality_db(cold, scene.views, cpu) + 1


def test_it_hangs_on_the_views_of_both_models_alone(opened: Callable[..., Scene]) -> None:
    straight, detour = opened("straight"), opened("detour")
    for scene in (straight, detour):
        scene.add(FIRST, Monitor())
        scene.train("full", Monitor())
    detour.add(["7.png"], Monitor())
    detour.train("quick", Monitor())
    for scene in (straight, detour):
        scene.add(["5.png", "7.png"], Monitor())
    expected, found = (scene.train("quick", Monitor()) for scene in (straight, detour))
    for name, tensor in expected.gaussians.tensors().items():
        assert torch.equal(tensor, found.gaussians.tensors()[name]), name


@pytest.mark.system
@pytest.mark.parametrize("stop", ["in the quick model", "after it", "in the full model"])
def test_a_killed_warm_start_comes_to_the_same_end(opened: Callable[..., Scene], stop: str) -> None:
    def stopping_at(iteration: int) -> Monitor:
        monitor = Monitor(lambda progress: monitor.cancel() if progress.done == iteration else None)
        return monitor

    def go_on(scene: Scene) -> list[SceneModel]:
        scene.add(["5.png"], Monitor())
        return [scene.train(quality, Monitor()) for quality in ("quick", "full")]

    models = []
    for folder in ("whole", "killed"):
        scene = opened(folder)
        scene.add(FIRST, Monitor())
        scene.train("full", Monitor())
        if folder == "killed":
            scene.add(["5.png"], Monitor())
            if stop == "in the quick model":
                with pytest.raises(Cancelled):
                    scene.train("quick", stopping_at(70))
            else:
                scene.train("quick", Monitor())
            if stop == "in the full model":
                with pytest.raises(Cancelled):
                    scene.train("full", stopping_at(40))
            scene = opened(folder)
        models.append(go_on(scene))
    for expected, found in zip(*models, strict=True):
        assert expected.iterations == found.iterations
        for name, tensor in expected.gaussians.tensors().items():
            assert torch.equal(tensor, found.gaussians.tensors()[name]), name


def test_a_full_model_that_was_not_finished_takes_nothing_from_the_last_one(
    opened: Callable[..., Scene],
) -> None:
    scene = opened()
    scene.add(FIRST, Monitor())
    full = scene.train("full", Monitor())
    scene.add(["5.png"], Monitor())
    stopping = Monitor(lambda progress: stopping.cancel() if progress.done == 40 else None)
    with pytest.raises(Cancelled):
        scene.train("full", stopping)
    scene.add(["6.png"], Monitor())
    assert went_on(scene.train("quick", Monitor()), full)


@pytest.mark.parametrize(
    ("names", "removed"),
    [((), ("4.png",)), (("3.png", "5.png", "6.png", "7.png"), ())],
    ids=["an image is gone", "too many are new"],
)
def test_else_a_quick_model_is_trained_anew(
    opened: Callable[..., Scene], names: Sequence[str], removed: Sequence[str]
) -> None:
    """A model that was trained on a deleted image must not live on in others."""
    scene = opened()
    scene.add(FIRST, Monitor())
    full = scene.train("full", Monitor())
    scene.add(names, Monitor(), removed=removed)
    assert not went_on(scene.train("quick", Monitor()), full)


def test_cameras_that_moved_by_more_than_two_pixels_are_a_reason_to_train_anew(
    opened: Callable[..., Scene], ball: Dataset
) -> None:
    scene = opened()
    scene.add(FIRST, Monitor())
    full, trained = scene.train("full", Monitor()), scene.views
    assert ball.points is not None
    points = ball.points.cloud

    def turned(px: float) -> list[TrainingView]:
        """The views, the third about its optical axis's normal by ``px`` at the centre of the image."""
        angle = px / trained[2].camera.fx
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        pose = trained[2].camera_from_model
        moved = RigidTransform(turn @ pose.rotation, turn @ pose.translation)
        return [replace(v, camera_from_model=moved) if v is trained[2] else v for v in trained]

    assert WarmStart.of(full, trained, turned(1.0), points) is not None
    assert WarmStart.of(full, trained, turned(4.0), points) is None
    assert WarmStart.of(full, trained, turned(1.0), PointCloud.empty()) is None
    assert WarmStart.of(full, trained, trained, PointCloud.empty()) is not None
