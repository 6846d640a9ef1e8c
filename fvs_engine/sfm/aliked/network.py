"""The network ALIKED-N(16): a score map and a feature map of an image, and descriptors of its keypoints.

Source: Zhao et al. 2023, sections III and IV. The names of the modules are those of the published weights.
"""

from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from fvs_engine.sfm.aliked.deformable import DeformableConvolution, sample

_CHANNELS = (16, 32, 64, 128)
"""Channels of the four blocks, which process the image at 1, 1/2, 1/8 and 1/32 of its size."""

_SCALES = (1, 2, 8, 32)

DIM = 128
"""Length of a descriptor."""

_POSITIONS = 16
"""Sample positions per keypoint: the 16 of ALIKED-N(16)."""


class _Block(nn.Module):
    """Two convolutions with normalisation; from the second block on with a residual connection."""

    def __init__(self, channels: int, out: int, *, deformable: bool, residual: bool) -> None:
        super().__init__()
        self.conv1 = _convolution(channels, out, deformable)
        self.bn1 = nn.BatchNorm2d(out)
        self.conv2 = _convolution(out, out, deformable)
        self.bn2 = nn.BatchNorm2d(out)
        self.downsample = nn.Conv2d(channels, out, 1) if residual else None

    def forward(self, features: Tensor) -> Tensor:
        """[B, C, H, W] → [B, D, H, W]."""
        out = self.bn2(self.conv2(functional.selu(self.bn1(self.conv1(features)))))
        if self.downsample is not None:
            out = out + self.downsample(features)
        return functional.selu(out)


def _convolution(channels: int, out: int, deformable: bool) -> nn.Module:
    if deformable:
        return DeformableConvolution(channels, out)
    return nn.Conv2d(channels, out, 3, padding=1, bias=False)


class _DescriptorHead(nn.Module):
    """Sparse deformable descriptors: features at 16 positions around each keypoint, weighted and summed."""

    def __init__(self) -> None:
        super().__init__()
        self.offset_conv = nn.Sequential(
            nn.Conv2d(DIM, 2 * _POSITIONS, 3), nn.SELU(), nn.Conv2d(2 * _POSITIONS, 2 * _POSITIONS, 1)
        )
        self.sf_conv = nn.Conv2d(DIM, DIM, 1, bias=False)
        self.agg_weights = nn.Parameter(torch.zeros(_POSITIONS, DIM, DIM))

    def forward(self, features: Tensor, keypoints: Tensor) -> Tensor:
        """Unit descriptors [K, 128] of ``keypoints`` [K, 2] (x, y in px) in ``features`` [128, H, W]."""
        height, width = features.shape[-2:]
        reach = max(height, width) / 4.0
        offsets = self.offset_conv(_neighbourhoods(features, keypoints)).clamp(-reach, reach)
        offsets = offsets.reshape(len(keypoints), 2, _POSITIONS).transpose(1, 2)
        positions = keypoints[:, None] + offsets
        sampled = sample(features[None], positions[None])[0].movedim(0, 1)  # [K, 128, 16]
        shaped = functional.selu(self.sf_conv(sampled[..., None])[..., 0])
        descriptors = torch.einsum("kcp,pcd->kd", shaped, self.agg_weights)
        return functional.normalize(descriptors, dim=1)


def _neighbourhoods(features: Tensor, keypoints: Tensor) -> Tensor:
    """The 3×3 pixels [K, C, 3, 3] around keypoints; at the right and lower edge those one pixel inside."""
    height, width = features.shape[-2:]
    corner = keypoints.long() - 1
    x = corner[:, 0].clamp(0, width - 4)[:, None, None] + torch.arange(3, device=corner.device)
    y = corner[:, 1].clamp(0, height - 4)[:, None, None] + torch.arange(3, device=corner.device)[:, None]
    return features[:, y, x].movedim(0, 1)


class Aliked(nn.Module):
    """ALIKED-N(16); ``load`` makes one with its trained weights."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third, fourth = _CHANNELS
        self.block1 = _Block(3, first, deformable=False, residual=False)
        self.block2 = _Block(first, second, deformable=False, residual=True)
        self.block3 = _Block(second, third, deformable=True, residual=True)
        self.block4 = _Block(third, fourth, deformable=True, residual=True)
        self.conv1, self.conv2, self.conv3, self.conv4 = (
            nn.Conv2d(channels, DIM // 4, 1, bias=False) for channels in _CHANNELS
        )
        self.score_head = nn.Sequential(
            nn.Conv2d(DIM, 8, 1, bias=False),
            nn.SELU(),
            nn.Conv2d(8, 4, 3, padding=1, bias=False),
            nn.SELU(),
            nn.Conv2d(4, 4, 3, padding=1, bias=False),
            nn.SELU(),
            nn.Conv2d(4, 1, 3, padding=1, bias=False),
        )
        self.desc_head = _DescriptorHead()

    @classmethod
    def load(cls, weights: Path) -> "Aliked":
        """The network with the weights of a file, for inference."""
        network = cls()
        network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
        return network.eval().requires_grad_(False)

    def maps(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Unit vectors [128, H, W] and scores [H, W] of the pixels of ``image`` [3, H, W], in [0, 1]."""
        height, width = image.shape[-2:]
        left, above = (-width % _SCALES[-1]) // 2, (-height % _SCALES[-1]) // 2
        right, below = -width % _SCALES[-1] - left, -height % _SCALES[-1] - above
        padded = functional.pad(image[None], (left, right, above, below), mode="replicate")
        first = self.block1(padded)
        second = self.block2(functional.avg_pool2d(first, 2))
        third = self.block3(functional.avg_pool2d(second, 4))
        fourth = self.block4(functional.avg_pool2d(third, 4))
        blocks = (first, second, third, fourth)
        parts = (
            functional.selu(convolution(block))
            for convolution, block in zip(
                (self.conv1, self.conv2, self.conv3, self.conv4), blocks, strict=True
            )
        )
        features = torch.cat(
            [
                functional.interpolate(part, scale_factor=scale, mode="bilinear", align_corners=True)
                if scale > 1
                else part
                for part, scale in zip(parts, _SCALES, strict=True)
            ],
            dim=1,
        )
        scores = torch.sigmoid(self.score_head(features))
        window = (..., slice(above, above + height), slice(left, left + width))
        return functional.normalize(features[window], dim=1)[0], scores[window][0, 0]

    def describe(self, features: Tensor, keypoints: Tensor) -> Tensor:
        """Unit descriptors [K, 128] of ``keypoints`` [K, 2] (x, y in px) in a feature map [128, H, W]."""
        if len(keypoints) == 0:
            return features.new_zeros((0, DIM))
        described: Tensor = self.desc_head(features, keypoints)
        return described
