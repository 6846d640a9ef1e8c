"""Adam over the Gaussians' parameters, and the moments that follow them when Gaussians come and go."""

from collections.abc import Mapping

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fvs_engine.compilation.kernels import kernel, parallel_kernel
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import LearningRates, sh_coefficient_count
from fvs_engine.splat.triton_kernels.guard import StepGuard

BETA_FIRST = 0.9
BETA_SECOND = 0.999
EPSILON = 1e-15

F32 = np.float32
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

SPARSE = frozenset({"sh_rest"})

_CHUNK = 1 << 15
_CHUNK_ROWS = 1 << 10
"""Numbers, and Gaussians, per unit of parallel work."""
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
    """Adam (Kingma and Ba, 2015), in place.

    Parameters in ``SPARSE`` move only where the Gaussian was seen: they are three quarters of the memory
    traffic that a step consists of. All others move with their momentum when unseen, too: 0.7 dB better after
    700 iterations, when most Gaussians have been seen only occasionally. ``first`` and ``second`` hold the
    moments by parameter name, shaped like the parameters; ``steps`` counts steps for the bias correction.
    """

    def __init__(self, gaussians: Gaussians) -> None:
        self.first = {name: torch.zeros_like(p) for name, p in gaussians.tensors().items()}
        self.second = {name: torch.zeros_like(p) for name, p in gaussians.tensors().items()}
        self.steps = 0

    def step(
        self,
        gaussians: Gaussians,
        rates: Mapping[str, float],
        radii_px: Tensor,
        sh_degree: int,
        guard: StepGuard | None = None,
    ) -> None:
        """Move every parameter along its ``.grad`` and clear that; sparse ones where ``radii_px`` [N] > 0.

        Only harmonics up to ``sh_degree`` are touched: the others had no part in the rendering. With the
        ``guard`` of a device its kernels compute it, and nothing moves once that is set.
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
            tensors = (parameter.detach(), gradient, self.first[name], self.second[name])
            if guard is not None:
                from fvs_engine.splat.triton_kernels.adam import adam_step

                adam_step(
                    tensors,
                    guard.words,
                    step_size=rates[name],
                    corrections=(correction_first, correction_second),
                    betas=(BETA_FIRST, BETA_SECOND),
                    epsilon=EPSILON,
                    radii=radii_px if name in SPARSE else None,
                    columns=columns,
                )
                continue
            p, g, m, v = (tensor.reshape(len(gaussians), -1).numpy() for tensor in tensors)
            rate, root_correction = F32(rates[name] / correction_first), F32(correction_second**-0.5)
            if name in SPARSE:
                visible = (radii_px > 0).numpy()
                adam_rows(p, g, m, v, visible, columns, rate, root_correction)
            else:
                adam_all(p.reshape(-1), g.reshape(-1), m.reshape(-1), v.reshape(-1), rate, root_correction)

    def keep(self, kept: Tensor, added: int) -> None:
        """Follow the Gaussians ``kept`` [M] (indices), then ``added`` new ones that start from rest."""
        for moments in (self.first, self.second):
            for name, moment in moments.items():
                fresh = moment.new_zeros((added, *moment.shape[1:]))
                moments[name] = torch.cat([moment[kept], fresh])

    def forget(self, name: str) -> None:
        """Zero the moments of one parameter, whose values were replaced."""
        self.first[name].zero_()
        self.second[name].zero_()


@kernel
def _adam(
    parameter: Floats,
    gradient: Floats,
    first: Floats,
    second: Floats,
    step_size: np.float32,
    root_correction: np.float32,
) -> None:
    for i in range(parameter.size):
        g = gradient[i]
        m = _B1 * first[i] + _ONE_B1 * g
        v = _B2 * second[i] + _ONE_B2 * g * g
        first[i] = m
        second[i] = v
        parameter[i] -= step_size * m / (np.sqrt(v) * root_correction + _EPSILON)


@parallel_kernel
def adam_all(
    parameter: Floats,
    gradient: Floats,
    first: Floats,
    second: Floats,
    step_size: np.float32,
    root_correction: np.float32,
) -> None:
    """One Adam step on flat arrays, in place."""
    size = parameter.size
    for chunk in numba.prange((size + _CHUNK - 1) // _CHUNK):
        a, b = chunk * _CHUNK, min((chunk + 1) * _CHUNK, size)
        _adam(parameter[a:b], gradient[a:b], first[a:b], second[a:b], step_size, root_correction)


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
    for chunk in numba.prange((count + _CHUNK_ROWS - 1) // _CHUNK_ROWS):
        for row in range(chunk * _CHUNK_ROWS, min((chunk + 1) * _CHUNK_ROWS, count)):
            if visible[row]:
                _adam(
                    parameter[row, :columns],
                    gradient[row, :columns],
                    first[row, :columns],
                    second[row, :columns],
                    step_size,
                    root_correction,
                )
