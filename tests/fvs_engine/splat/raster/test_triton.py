"""The triton backend in rendering and training; without a device its kernels run in Triton's interpreter."""

from collections.abc import Iterator
from unittest.mock import patch

import numpy as np
import pytest
import torch
from random_gaussians import random_gaussians

from fvs_engine.errors import Cancelled, TrainingError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import BatchRasterizer, Rasterizer, SquaringRasterizer, create_rasterizer
from fvs_engine.splat.raster.triton import TritonRasterizer
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.triton_kernels import photometric
from fvs_engine.splat.views import TrainingView

CAMERA = PinholeCamera(18, 7, 22.0, 21.0, 9.5, 3.0)  # two tiles
SETTINGS = TrainingSettings(
    iterations=3,
    sh_degree=1,
    sh_degree_interval=2,
    densification=Densification(first_iteration=1, last_iteration=3, interval=2, gradient_threshold=1e-7),
)


@pytest.fixture(scope="module", autouse=True)
def low_images() -> Iterator[None]:
    """The loss takes few rows at once: in the interpreter it computes them all."""
    with patch.object(photometric, "_ROWS", 8):
        yield


@pytest.fixture(scope="module")
def triton() -> TritonRasterizer:
    rasterizer = create_rasterizer("triton")
    assert isinstance(rasterizer, TritonRasterizer)
    return rasterizer


@pytest.fixture(scope="module")
def views() -> tuple[TrainingView, ...]:
    model = random_gaussians(30, 0, seed=5)
    made = []
    for name, shift in (("a", 0.0), ("b", 0.4)):
        pose = RigidTransform(np.eye(3), np.array([shift, 0.0, 4.0]))
        color = create_rasterizer("cpu").render(model, CAMERA, pose).color
        image = (color.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
        made.append(TrainingView(name, CAMERA, pose, image))
    return tuple(made)


def start() -> Gaussians:
    return random_gaussians(12, 1, seed=6)


def trained(views: tuple[TrainingView, ...], rasterizer: Rasterizer, capacity: int | None = None) -> Trainer:
    trainer = Trainer(views, start(), SETTINGS, rasterizer)
    if trainer._guard is not None:
        trainer._guard.capacity = capacity
    trainer.train(SETTINGS.iterations, Monitor())
    return trainer


@pytest.fixture(scope="module")
def ample(views: tuple[TrainingView, ...], triton: TritonRasterizer) -> Trainer:
    """Trained with room for all hits."""
    return trained(views, triton)


def numbers(trainer: Trainer) -> dict[str, torch.Tensor]:
    return {name: tensor.detach().cpu() for name, tensor in trainer.gaussians.tensors().items()}


def test_a_batch_shows_what_single_renders_and_the_cpu_show(
    triton: TritonRasterizer, views: tuple[TrainingView, ...]
) -> None:
    assert isinstance(triton, BatchRasterizer)
    model = start().to(triton.device)
    with torch.no_grad():
        colors, alphas = triton.render_batch(model, views, sh_degree=0)
        for color, alpha, view in zip(colors, alphas, views, strict=True):
            alone = triton.render(model, view.camera, view.camera_from_model, sh_degree=0)
            assert torch.equal(color, alone.color)
            assert torch.equal(alpha, alone.alpha)
            on_cpu = create_rasterizer("cpu").render(
                start(), view.camera, view.camera_from_model, sh_degree=0
            )
            for name in ("color", "alpha", "depth", "radii_px"):
                torch.testing.assert_close(
                    getattr(alone, name).cpu(), getattr(on_cpu, name), rtol=1e-4, atol=1e-4
                )


def test_the_squared_jacobian_is_that_of_the_cpu(
    triton: TritonRasterizer, views: tuple[TrainingView, ...]
) -> None:
    pose = views[0].camera_from_model
    found = triton.squared_jacobian(start().to(triton.device), CAMERA, pose)
    cpu = create_rasterizer("cpu")
    assert isinstance(cpu, SquaringRasterizer)
    expected = cpu.squared_jacobian(start(), CAMERA, pose)
    for name in ("means", "log_scales", "opacity_logits", "sh_dc", "sh_rest", "alpha"):
        wanted = getattr(expected, name)
        largest = float(wanted.abs().max())
        torch.testing.assert_close(getattr(found, name).cpu(), wanted, rtol=1e-3, atol=1e-4 * largest)


@pytest.mark.system
def test_training_is_that_of_the_cpu_and_room_for_hits_changes_no_bit(
    triton: TritonRasterizer, views: tuple[TrainingView, ...], ample: Trainer
) -> None:
    cramped = trained(views, triton, capacity=2)
    assert cramped._guard is not None
    assert cramped._guard.capacity > 2
    assert cramped.iteration == ample.iteration == SETTINGS.iterations
    assert cramped.optimiser.steps == ample.optimiser.steps
    for name, tensor in numbers(ample).items():
        assert torch.equal(numbers(cramped)[name], tensor), name
    on_cpu = trained(views, create_rasterizer("cpu"))
    assert len(on_cpu.gaussians) > 12
    for name, tensor in numbers(on_cpu).items():
        torch.testing.assert_close(numbers(ample)[name], tensor, rtol=1e-3, atol=1e-3, msg=name)


@pytest.mark.system
def test_a_loss_that_is_not_finite_changes_nothing(
    triton: TritonRasterizer, views: tuple[TrainingView, ...]
) -> None:
    settings = SETTINGS.model_copy(update={"densification": Densification(first_iteration=100)})
    trainer = Trainer(views, start(), settings, triton)
    trainer.train(1, Monitor())
    with torch.no_grad():
        trainer.gaussians.sh_dc[:] = torch.nan
    before = numbers(trainer)
    with pytest.raises(TrainingError, match=r"diverged at iteration 1: the loss on [ab] is nan"):
        trainer.train(4, Monitor())
    for name, tensor in numbers(trainer).items():
        torch.testing.assert_close(tensor, before[name], rtol=0, atol=0, equal_nan=True, msg=name)


@pytest.mark.system
def test_a_cancelled_training_has_no_step_in_flight(
    triton: TritonRasterizer, views: tuple[TrainingView, ...], ample: Trainer
) -> None:
    monitor = Monitor(lambda _: monitor.cancel())
    trainer = Trainer(views, start(), SETTINGS, triton)
    with pytest.raises(Cancelled):
        trainer.train(SETTINGS.iterations, monitor)
    assert not trainer._in_flight
    trainer.train(SETTINGS.iterations, Monitor())
    for name, tensor in numbers(ample).items():
        assert torch.equal(numbers(trainer)[name], tensor), name
