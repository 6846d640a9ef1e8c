"""Deformable convolution: each tap of the kernel reads the input at an offset that the input determines.

Source: Dai et al., "Deformable Convolutional Networks", ICCV 2017, section 2.1.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional


def deformable_convolution(features: Tensor, offsets: Tensor, weight: Tensor) -> Tensor:
    """The 3×3 convolution of ``features`` [B, C, H, W] by ``weight`` [D, C, 3, 3] at displaced positions.

    ``offsets`` [B, 18, H, W] hold, for the nine taps row by row, the displacement in y and in x, in px.
    Values between pixels are bilinear, those outside are zero. Returns [B, D, H, W].
    """
    batch, channels, height, width = features.shape
    taps = torch.arange(-1, 2, dtype=features.dtype, device=features.device)
    rows = torch.arange(height, dtype=features.dtype, device=features.device)
    columns = torch.arange(width, dtype=features.dtype, device=features.device)
    dy, dx = offsets.reshape(batch, 9, 2, height, width).unbind(dim=2)
    y = dy + taps.repeat_interleave(3)[:, None, None] + rows[:, None]
    x = dx + taps.repeat(3)[:, None, None] + columns
    sampled = sample(features, torch.stack((x, y), dim=-1).reshape(batch, 9 * height, width, 2))
    taken = sampled.reshape(batch, channels * 9, height * width)
    out: Tensor = weight.reshape(len(weight), -1) @ taken
    return out.reshape(batch, len(weight), height, width)


def sample(features: Tensor, positions: Tensor) -> Tensor:
    """The bilinear values [B, C, M, N] of ``features`` [B, C, H, W] at ``positions`` [B, M, N, 2].

    Positions are x, y in px, (0, 0) the centre of the first pixel; outside the image the values are zero.
    """
    height, width = features.shape[-2:]
    # An image of one row or column has no extent to divide by.
    extent = positions.new_tensor([max(width - 1, 1), max(height - 1, 1)])
    shares = 2.0 * positions / extent - 1.0
    return functional.grid_sample(features, shares, mode="bilinear", padding_mode="zeros", align_corners=True)


class DeformableConvolution(nn.Module):
    """A 3×3 deformable convolution; a plain one predicts its offsets, at most a quarter of the long side."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__()
        self.offset_conv = nn.Conv2d(channels, 18, 3, padding=1)
        self.regular_conv = nn.Conv2d(channels, out, 3, padding=1, bias=False)

    def forward(self, features: Tensor) -> Tensor:
        """[B, C, H, W] → [B, D, H, W]."""
        reach = max(features.shape[-2:]) / 4.0
        offsets = self.offset_conv(features).clamp(-reach, reach)
        return deformable_convolution(features, offsets, self.regular_conv.weight)
