"""Calls every kernel of the estimate once, on next to nothing: see ``compilation.ahead``."""

from collections.abc import Callable

import torch

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.score.estimate.nearness import Nearness
from fvs_engine.score.estimate.splat_table import SplatTable
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView


def _estimate() -> None:
    draw = torch.Generator().manual_seed(0)
    gaussians = Gaussians(
        means=torch.rand((8, 3), generator=draw) + torch.tensor([0.0, 0.0, 2.0]),
        log_scales=torch.full((8, 3), -2.0),
        quaternions_wxyz=torch.rand((8, 4), generator=draw),
        opacity_logits=torch.zeros(8),
        sh_dc=torch.rand((8, 3), generator=draw),
        sh_rest=torch.zeros(8, 0, 3),
    )
    camera = PinholeCamera(32, 24, 30.0, 30.0, 16.0, 12.0)
    view = PinholeView("view", camera, RigidTransform.identity())
    SplatTable.of(gaussians).estimate(view)
    Nearness.of(gaussians, [view]).look(view)


STEPS: tuple[Callable[[], None], ...] = (_estimate,)
