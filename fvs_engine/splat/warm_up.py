"""Calls every kernel of training and rendering once, on next to nothing: see ``compilation.ahead``."""

from collections.abc import Callable

import numpy as np
import torch

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.cpu import CpuRasterizer
from fvs_engine.splat.settings import TrainingSettings, sh_coefficient_count
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView

_CAMERA = PinholeCamera(40, 30, 30.0, 30.0, 20.0, 15.0)
_POSE = RigidTransform.identity()
_DEGREE = 3


def _gaussians() -> Gaussians:
    draw = torch.Generator().manual_seed(0)
    count = 9
    return Gaussians(
        means=torch.randn((count, 3), generator=draw) + torch.tensor([0.0, 0.0, 4.0]),
        log_scales=torch.randn((count, 3), generator=draw) - 2,
        quaternions_wxyz=torch.randn((count, 4), generator=draw),
        opacity_logits=torch.randn(count, generator=draw),
        sh_dc=torch.randn((count, 3), generator=draw),
        sh_rest=torch.randn((count, sh_coefficient_count(_DEGREE) - 1, 3), generator=draw),
    )


def _render() -> None:
    CpuRasterizer().render(_gaussians(), _CAMERA, _POSE)


def _train() -> None:
    image = np.full((_CAMERA.height, _CAMERA.width, 3), 128, np.uint8)
    view = TrainingView("warm-up", _CAMERA, _POSE, image)
    settings = TrainingSettings(sh_degree=_DEGREE, sh_degree_interval=1)
    Trainer((view,), _gaussians(), settings, CpuRasterizer()).train(_DEGREE + 1, Monitor())


def _differentiate_depth() -> None:
    rendering = CpuRasterizer().render(_gaussians().requires_grad_(), _CAMERA, _POSE)
    (rendering.color.sum() + rendering.alpha.sum() + rendering.depth.sum()).backward()  # type: ignore[no-untyped-call]


def _square() -> None:
    CpuRasterizer().squared_jacobian(_gaussians(), _CAMERA, _POSE)


STEPS: tuple[Callable[[], None], ...] = (_render, _train, _differentiate_depth, _square)
