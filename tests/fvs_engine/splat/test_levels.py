"""Training from small images to large ones."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.splat import views
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.selection import create_rasterizer
from fvs_engine.splat.settings import Densification, Level, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView

SETTINGS = TrainingSettings(
    iterations=12,
    sh_degree=0,
    levels=(Level(until_iteration=4, reduction=4), Level(until_iteration=8, reduction=2)),
)


@pytest.fixture(autouse=True)
def _small_images_are_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(views, "MIN_LONG_SIDE_PX", 12)


def test_images_grow_with_the_levels(
    scene_views: tuple[TrainingView, ...], start: Callable[[int], Gaussians]
) -> None:
    cpu = create_rasterizer("cpu")
    sizes: list[tuple[int, int]] = []

    class Watching:
        name, device, steps_on_device = cpu.name, cpu.device, False

        def render(self, gaussians, camera, camera_from_model, **options):  # type: ignore[no-untyped-def]
            sizes.append((camera.width, camera.height))
            return cpu.render(gaussians, camera, camera_from_model, **options)

    reports: list[Progress] = []
    Trainer(scene_views, start(0), SETTINGS, Watching()).train(12, Monitor(reports.append))
    assert sizes == [(12, 10)] * 4 + [(24, 20)] * 4 + [(48, 40)] * 4
    assert [report.share for report in reports[3::4]] == pytest.approx([1 / 7, 3 / 7, 1.0])


def test_the_model_grows_with_the_levels(
    scene_views: tuple[TrainingView, ...], start: Callable[[int], Gaussians]
) -> None:
    settings = TrainingSettings(
        iterations=120,
        sh_degree=0,
        max_gaussians=160,
        densification=Densification(first_iteration=5, last_iteration=100, interval=10),
        levels=(
            Level(until_iteration=41, reduction=4, growth=0.5),
            Level(until_iteration=81, reduction=2, growth=0.75),
        ),
    )
    trainer = Trainer(scene_views, start(0), settings, create_rasterizer("cpu"))
    sizes = []
    for until in (41, 81, 120):
        trainer.train(until, Monitor())
        sizes.append(len(trainer.gaussians))
    assert sizes[0] <= 80 < sizes[1] <= 120 < sizes[2] <= 160


@pytest.mark.parametrize("stop", [2, 4, 6, 8])
def test_a_run_resumed_at_any_level_equals_an_uninterrupted_one(
    scene_views: tuple[TrainingView, ...], start: Callable[[int], Gaussians], tmp_path: Path, stop: int
) -> None:
    cpu = create_rasterizer("cpu")
    whole, first = (Trainer(scene_views, start(0), SETTINGS, cpu) for _ in range(2))
    whole.train(12, Monitor())
    first.train(stop, Monitor())
    first.save(tmp_path / "checkpoint.safetensors")
    second = Trainer.resume(tmp_path / "checkpoint.safetensors", scene_views, cpu)
    second.train(12, Monitor())
    for name, tensor in whole.gaussians.tensors().items():
        assert torch.equal(tensor, second.gaussians.tensors()[name]), name


def test_a_reduced_view_shows_the_same() -> None:
    columns, rows = np.meshgrid(np.arange(96), np.arange(48))
    image = np.stack([2 * columns, 4 * rows, columns + rows], axis=-1).astype(np.uint8)
    camera = PinholeCamera(96, 48, 80.0, 80.0, 48.0, 24.0)
    view = TrainingView("a.png", camera, RigidTransform(np.eye(3), np.zeros(3)), image)
    reduced = view.reduced(4)
    assert (reduced.camera.width, reduced.camera.height) == (24, 12)
    point = np.array([0.2, -0.1, 1.0])
    (x, y), (u, v) = camera.project(point), reduced.camera.project(point)
    assert (u, v) == pytest.approx((x / 4, y / 4))
    before = image[int(y), int(x)].astype(int)
    assert np.abs(reduced.image[int(v), int(u)].astype(int) - before).max() <= 8
    assert view.reduced(100).camera.width == 12
    assert view.reduced(1) is view
