"""LPIPS, where its packages and weights are installed; nothing is downloaded.

Two packages provide the metric, ``lpips`` and ``torchmetrics``. Both ship the linear weights of LPIPS and
load its backbone, VGG-16 as torchvision publishes it, from torch's checkpoint folder; without the file they
would download it. Source: Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual
Metric", 2018; papers on Gaussian splatting report the VGG variant.
"""

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

BACKBONE_FILE = "vgg16-397923af.pth"
"""The name under which torchvision keeps the weights of VGG-16."""
PACKAGES = ("lpips", "torchmetrics")


@dataclass(frozen=True)
class LpipsStatus:
    """``compute(a, b)`` for two images [H, W, 3] in [0, 1]: 0 for equal ones, more is worse.

    Where it cannot be computed, ``compute`` is None and ``reason`` explains why.
    """

    compute: Callable[[ArrayLike, ArrayLike], float] | None
    reason: str


def find_lpips(device: torch.device) -> LpipsStatus:
    """Look for a package and its weights on this machine; the metric is computed on ``device``."""
    package = next((name for name in PACKAGES if importlib.util.find_spec(name) is not None), None)
    if package is None:
        return LpipsStatus(None, f"neither {' nor '.join(PACKAGES)} is installed")
    if importlib.util.find_spec("torchvision") is None:
        return LpipsStatus(None, f"torchvision, which {package} needs for it, is not installed")
    backbone = Path(torch.hub.get_dir()) / "checkpoints" / BACKBONE_FILE
    if not backbone.is_file():
        return LpipsStatus(None, f"the weights of VGG-16 are not at {backbone}, and nothing is downloaded")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # both call torchvision in ways that it has deprecated
            metric = (_from_lpips() if package == "lpips" else _from_torchmetrics()).to(device)
    except (ImportError, RuntimeError, OSError) as error:  # such as a torchvision built for another torch
        return LpipsStatus(None, f"{package} does not work here ({type(error).__name__}: {error})")

    def compute(a: ArrayLike, b: ArrayLike) -> float:
        with torch.no_grad():
            return float(metric(_batch(a).to(device), _batch(b).to(device)).mean())

    return LpipsStatus(compute, f"VGG-16, by the package {package}")


def _from_lpips() -> torch.nn.Module:
    return importlib.import_module("lpips").LPIPS(net="vgg", verbose=False).eval()  # type: ignore[no-any-return]


def _from_torchmetrics() -> torch.nn.Module:
    metric = importlib.import_module("torchmetrics.image.lpip").LearnedPerceptualImagePatchSimilarity
    return metric(net_type="vgg").eval()  # type: ignore[no-any-return]


def _batch(image: ArrayLike) -> Tensor:
    """[1, 3, H, W] in [−1, 1], as the network was trained."""
    values = np.clip(np.asarray(image, np.float32), 0, 1)
    return torch.from_numpy(values.transpose(2, 0, 1)[None] * 2 - 1)
