"""Keypoints and descriptors of a photograph."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.sfm.aliked.detection import detect
from fvs_engine.sfm.aliked.network import Aliked

LONG_SIDE_PX = 1024
"""Images are resized to this long side."""

MAX_KEYPOINTS = 2048
_LEAST_SCORE = 0.2


@dataclass(frozen=True, eq=False)
class AlikedFeatures:
    """``keypoints`` [K, 2] in px of the full-size image, and their unit ``descriptors`` [K, 128]."""

    keypoints: NDArray[np.float32]
    descriptors: NDArray[np.float32]


def extract(network: Aliked, image: Image.Image) -> AlikedFeatures:
    """The features of a photograph, those with the highest scores first."""
    shrunk = LONG_SIDE_PX / max(image.size)
    width, height = (max(1, round(side * shrunk)) for side in image.size)
    pixels = np.asarray(image.convert("RGB").resize((width, height), Image.Resampling.BILINEAR))
    tensor = torch.from_numpy(pixels.copy()).permute(2, 0, 1).to(torch.float32) / 255.0
    with torch.inference_mode():
        features, scores = network.maps(tensor)
        found = detect(scores, _LEAST_SCORE, MAX_KEYPOINTS)
        descriptors = network.describe(features, found)
    scale = np.array([image.width / width, image.height / height], dtype=np.float32)
    return AlikedFeatures((found.numpy() + np.float32(0.5)) * scale, descriptors.numpy())
