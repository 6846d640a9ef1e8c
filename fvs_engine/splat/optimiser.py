"""Adam over the Gaussians' parameters, and the moments that follow them when Gaussians come and go."""

from collections.abc import Mapping

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fvs_engine.kernels import kernel, parallel_kernel
from fvs_engine.splat.gaussians import Gaussians, sh_coefficient_count
from fvs_engine.splat.settings import LearningRates

BETA_FIRST = 0.9
BETA_SECOND = 0.999
EPSILON = 1e-15

F32 = np.float32
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

_CHUNK = 2048
"""Gaussians in one piece of parallel work."""
_B1, _B2 = F32(BETA_FIRST), F32(BETA_SECOND)
_ONE_B1, _ONE_B2 = F32(1 - BETA_FIRST), F32(1 - BETA_SECOND)
_EPSILON = F32(EPSILON)


def learning_rates_at(
    rates: LearningRates, iteration: int, iterations: int, extent: float
) -> dict[str, float]:
    """The step size of every parameter at an iteration; that of the means decays exponentially.

    The means' rate runs from first to last over ``iterations``, times the scene's ``extent``, and stays.
    """
    progress = min(1.0, iteration / iterations)
    means = rates.means_first ** (1 - progress) * rates.means_last**progress
    return {
        "means": means * extent,
        "log_scales": rates.log_scales,
        "quaternions_wxyz": rates.quaternions_wxyz,
        "opacity_logits": rates.opacity_logits,
        "sh_dc": rates.sh_dc,
        "sh_rest": rates.sh_rest,
    }


class GaussianAdam:
    """Adam (Kingma and Ba, 2015) that touches only Gaussians which were seen, in place.

    A Gaussian outside the view has no gradient; leaving its moments alone keeps them meaningful and saves
    the memory traffic that the step consists of. ``first`` and ``second`` hold the moments by parameter
    name, shaped like the parameters; ``steps`` counts steps for the bias correction.
    """

    def __init__(self, gaussians: Gaussians) -> None:
        self.first = {name: torch.zeros_like(p) for name, p in gaussians.tensors().items()}
        self.second = {name: torch.zeros_like(p) for name, p in gaussians.tensors().items()}
        self.steps = 0

    def step(self, gaussians: Gaussians, rates: Mapping[str, float], visible: Tensor, sh_degree: int) -> None:
        """Move the parameters of ``visible`` [N] (bool) Gaussians along their ``.grad`` and clear it.

        Only harmonics up to ``sh_degree`` are touched: the others had no part in the rendering.
        """
        self.steps += 1
        correction_first = 1 - BETA_FIRST**self.steps
        correction_second = 1 - BETA_SECOND**self.steps
        for name, parameter in gaussians.tensors().items():
            gradient, parameter.grad = parameter.grad, None
            columns = parameter[0].numel() if len(gaussians) else 0
            if name == "sh_rest":
                columns = min(columns, 3 * (sh_coefficient_count(sh_degree) - 1))
            if gradient is None or columns == 0:
                continue
            step_size = rates[name] / correction_first
            tensors = (parameter.detach(), gradient, self.first[name], self.second[name])
            if parameter.device.type == "cpu":
                p, g, m, v = (tensor.reshape(len(gaussians), -1).numpy() for tensor in tensors)
                adam_rows(
                    p,
                    g,
                    m,
                    v,
                    visible.numpy(),
                    columns,
                    F32(step_size),
                    F32(1 / correction_second**0.5),
                )
            else:
                _adam_torch(tensors, visible, columns, step_size, correction_second)

    def keep(self, kept: Tensor, added: int) -> None:
        """Follow the Gaussians ``kept`` [M] (indices), then ``added`` new ones that start from rest."""
        for moments in (self.first, self.second):
            for name, moment in moments.items():
                fresh = moment.new_zeros((added, *moment.shape[1:]))
                moments[name] = torch.cat([moment[kept], fresh])

    def forget(self, name: str) -> None:
        """Zero the moments of one parameter: it was set to other values."""
        self.first[name].zero_()
        self.second[name].zero_()


def _adam_torch(
    tensors: tuple[Tensor, ...], visible: Tensor, columns: int, step_size: float, correction_second: float
) -> None:
    """The kernel below in plain torch, for devices without Numba: the oracle of its tests."""
    parameter, gradient, first, second = (t.reshape(len(visible), -1)[:, :columns] for t in tensors)
    seen = visible[:, None]
    first.copy_(torch.where(seen, first.lerp(gradient, 1 - BETA_FIRST), first))
    second.copy_(torch.where(seen, second * BETA_SECOND + (1 - BETA_SECOND) * gradient**2, second))
    update = step_size * first / ((second / correction_second).sqrt() + EPSILON)
    parameter.sub_(torch.where(seen, update, torch.zeros_like(update)))


@kernel
def _adam_chunk(
    parameter: Floats,
    gradient: Floats,
    first: Floats,
    second: Floats,
    visible: Mask,
    columns: int,
    step_size: np.float32,
    root_correction: np.float32,
) -> None:
    for row in range(parameter.shape[0]):
        if not visible[row]:
            continue
        p, g, m, v = parameter[row], gradient[row], first[row], second[row]
        for i in range(columns):
            gi = g[i]
            mi = _B1 * m[i] + _ONE_B1 * gi
            vi = _B2 * v[i] + _ONE_B2 * gi * gi
            m[i] = mi
            v[i] = vi
            p[i] -= step_size * mi / (np.sqrt(vi) * root_correction + _EPSILON)


@parallel_kernel
def adam_rows(
    parameter: Floats,
    gradient: Floats,
    first: Floats,
    second: Floats,
    visible: Mask,
    columns: int,
    step_size: np.float32,
    root_correction: np.float32,
) -> None:
    """One Adam step on the first ``columns`` of the visible rows of [N, D] arrays, in place."""
    count = parameter.shape[0]
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        a, b = chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)
        _adam_chunk(
            parameter[a:b],
            gradient[a:b],
            first[a:b],
            second[a:b],
            visible[a:b],
            columns,
            step_size,
            root_correction,
        )
