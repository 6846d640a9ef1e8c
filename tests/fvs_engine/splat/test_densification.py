import math
from collections.abc import Callable

import pytest
import torch

from fvs_engine.splat.densification import (
    GradientStatistics,
    densify,
    is_due,
    reset_is_due,
    reset_opacities,
)
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.optimiser import GaussianAdam
from fvs_engine.splat.raster.interface import Rendering
from fvs_engine.splat.settings import Densification

Make = Callable[..., Gaussians]
EXTENT = 10.0
SMALL, LARGE, HUGE = math.log(0.05), math.log(0.5), math.log(3.0)


def grow(
    model: Gaussians, gradients: list[float], max_gaussians: int = 1000, prune_large: bool = False
) -> tuple[Gaussians, GaussianAdam]:
    adam = GaussianAdam(model)
    for moment in adam.first.values():
        moment += torch.arange(len(model)).reshape(-1, *[1] * (moment.dim() - 1)) + 1
    statistics = GradientStatistics(len(model), model.device)
    statistics.total[:] = torch.tensor(gradients) * 4
    statistics.views[:] = 4
    grown = densify(
        model,
        adam,
        statistics,
        Densification(),
        extent=EXTENT,
        max_gaussians=max_gaussians,
        prune_large=prune_large,
        generator=torch.Generator().manual_seed(0),
    )
    return grown, adam


@pytest.fixture
def model(make_gaussians: Make) -> Gaussians:
    gaussians = make_gaussians(4, 1)
    gaussians.log_scales[:] = SMALL
    return gaussians


def test_small_ones_are_cloned(model: Gaussians) -> None:
    grown, adam = grow(model, [0, 3e-4, 1e-4, 0])
    assert len(grown) == 5
    for name, tensor in grown.tensors().items():
        assert torch.equal(tensor[:4], model.tensors()[name])
        assert torch.equal(tensor[4], tensor[1])
    assert adam.first["means"][:, 0].tolist() == [1, 2, 3, 4, 0]


def test_large_ones_become_two_smaller_ones_inside_them(make_gaussians: Make) -> None:
    model = make_gaussians(400, 0)
    model.log_scales[:] = LARGE
    model.log_scales[:, 0] = SMALL
    grown, adam = grow(model, [1.0] * 200 + [0.0] * 200)
    assert len(grown) == 600
    assert torch.equal(grown.means[:200], model.means[200:])
    torch.testing.assert_close(grown.log_scales[200:], (model.log_scales[:200] - math.log(1.6)).repeat(2, 1))
    spread = (grown.means[200:] - model.means[:200].repeat(2, 1)).norm(dim=1).square().mean()
    assert spread.item() == pytest.approx(2 * 0.5**2 + 0.05**2, rel=0.2)
    assert not adam.first["means"][200:].any()


def test_the_cap_takes_the_largest_gradients(model: Gaussians) -> None:
    grown, _ = grow(model, [4e-4, 9e-4, 3e-4, 8e-4], max_gaussians=6)
    assert len(grown) == 6
    assert torch.equal(grown.means[4:], model.means[[1, 3]])
    full, _ = grow(model, [4e-4, 9e-4, 3e-4, 8e-4], max_gaussians=2)
    assert len(full) == 4


def test_transparent_and_oversized_ones_go(model: Gaussians) -> None:
    model.opacity_logits[:] = 0
    model.opacity_logits[2] = -6
    model.log_scales[3] = HUGE
    grown, adam = grow(model, [0.0] * 4)
    assert torch.equal(grown.means, model.means[[0, 1, 3]])
    grown, adam = grow(model, [0.0] * 4, prune_large=True)
    assert torch.equal(grown.means, model.means[[0, 1]])
    assert adam.first["sh_dc"][:, 0].tolist() == [1, 2]


def test_something_always_remains(model: Gaussians) -> None:
    model.opacity_logits[:] = torch.tensor([-9.0, -8.0, -7.0, -10.0])
    grown, _ = grow(model, [0.0] * 4)
    assert torch.equal(grown.means, model.means[2:3])


def test_gradients_are_measured_in_half_images_over_the_views_that_saw_them() -> None:
    statistics = GradientStatistics(3, torch.device("cpu"))
    for gradient in (3e-6, 6e-6):
        centers = torch.zeros(3, 2, requires_grad=True)
        centers.grad = torch.tensor([[gradient, 0], [0, gradient], [gradient, 0]])
        radii = torch.tensor([2.0, 2.0, 0.0])
        statistics.add(
            Rendering(torch.zeros(60, 100, 3), torch.zeros(60, 100), torch.zeros(1), radii, centers)
        )
    torch.testing.assert_close(statistics.mean(), torch.tensor([4.5e-6 * 50, 4.5e-6 * 30, 0.0]))


def test_reset_opacities_are_low_and_forget_their_momentum(model: Gaussians) -> None:
    adam = GaussianAdam(model)
    adam.second["opacity_logits"] += 1
    model.opacity_logits[0] = -8
    reset_opacities(model, adam)
    opacities = torch.sigmoid(model.opacity_logits)
    assert opacities[0].item() == pytest.approx(math.exp(-8), rel=1e-3)
    torch.testing.assert_close(opacities[1:], torch.full((3,), 0.01).minimum(opacities[1:]))
    assert not adam.second["opacity_logits"].any()


def test_schedule_of_the_paper() -> None:
    rules = Densification()
    due = [i for i in range(30_001) if is_due(rules, i)]
    assert (due[0], due[1], due[-1]) == (600, 700, 15_000)
    assert [i for i in range(30_001) if reset_is_due(rules, i)] == [3000, 6000, 9000, 12000]
