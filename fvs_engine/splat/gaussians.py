"""The 3D Gaussian model."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class Gaussians:
    """N Gaussians, in the unconstrained parameters that the optimiser sees (float32).

    The covariance is R S Sᵀ Rᵀ with S = diag(exp(log_scales)) and R from the normalised quaternion; the
    opacity is sigmoid(opacity_logits). The colour seen from a direction is 0.5 + Σ SH · coefficients,
    clamped at 0. Source: Kerbl et al., "3D Gaussian Splatting", 2023.

    Shapes: ``means`` [N, 3] in the model frame; ``log_scales`` [N, 3]; ``quaternions_wxyz`` [N, 4], any
    length; ``opacity_logits`` [N]; ``sh_dc`` [N, 3]; ``sh_rest`` [N, K − 1, 3] with K = (degree + 1)².
    """

    means: Tensor
    log_scales: Tensor
    quaternions_wxyz: Tensor
    opacity_logits: Tensor
    sh_dc: Tensor
    sh_rest: Tensor

    def __len__(self) -> int:
        return int(self.means.shape[0])

    @property
    def sh_degree(self) -> int:
        """The highest spherical-harmonics degree that is stored."""
        return int((self.sh_rest.shape[1] + 1) ** 0.5) - 1

    def degree_in_use(self, wanted: int | None) -> int:
        """The degree to render with: ``wanted`` (None: all), as far as it is stored."""
        return self.sh_degree if wanted is None else min(wanted, self.sh_degree)

    @property
    def device(self) -> torch.device:
        """The device of the tensors."""
        return self.means.device

    def tensors(self) -> dict[str, Tensor]:
        """Name → tensor, in a fixed order."""
        return {
            "means": self.means,
            "log_scales": self.log_scales,
            "quaternions_wxyz": self.quaternions_wxyz,
            "opacity_logits": self.opacity_logits,
            "sh_dc": self.sh_dc,
            "sh_rest": self.sh_rest,
        }

    def to(self, device: torch.device | str) -> "Gaussians":
        """The same Gaussians on another device."""
        return Gaussians(**{name: tensor.to(device) for name, tensor in self.tensors().items()})

    def requires_grad_(self, required: bool = True) -> "Gaussians":
        """Turn gradients on (or off) for every parameter, in place."""
        for tensor in self.tensors().values():
            tensor.requires_grad_(required)
        return self
