"""A small scene that every test of a scorer can render."""

import math

import pytest
import torch

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView


@pytest.fixture
def ball() -> Gaussians:
    """Four hundred opaque, colourful Gaussians within one unit of the origin."""
    generator = torch.Generator().manual_seed(0)
    count = 400
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    return Gaussians(
        means=directions * torch.rand(count, 1, generator=generator) ** (1 / 3),
        log_scales=torch.full((count, 3), math.log(0.12)),
        quaternions_wxyz=torch.randn(count, 4, generator=generator),
        opacity_logits=torch.full((count,), 3.0),
        sh_dc=torch.randn(count, 3, generator=generator),
        sh_rest=torch.zeros(count, 0, 3),
    )


@pytest.fixture
def candidate_at():
    """Make a candidate: ``candidate_at(id, centre, target=(0, 0, 0))``."""
    camera = PinholeCamera(48, 36, 40.0, 40.0, 24.0, 18.0)

    def make(name, centre, target=(0.0, 0.0, 0.0), camera=camera) -> PinholeView:
        return PinholeView(name, camera, look_at(centre, target, (0.0, 0.0, 1.0)).inverse())

    return make
