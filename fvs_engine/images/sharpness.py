"""How sharp an image is."""

import numpy as np
from PIL import Image

SHARP = 0.25
"""Images below this ``sharpness`` are blurred: photographs of ten scenes have 0.5 to 3.0, and 0.07 to 0.18
after a Gaussian blur of 2 px (of 1024)."""
SHARPNESS_SIDE_PX = 1024
"""Long side of the image that is measured."""
_REDUCING_GAP = 1.5
"""Larger images are first reduced by an integer factor to at least this multiple of that size: this halves
the time, and changes the sharpness by a few per cent."""


def measure_sharpness(image: Image.Image) -> float:
    """The gradient energy of an image at its finest scale relative to the next coarser one.

    The image is reduced to 1024 px. In a smooth image halving doubles every gradient, so that their energy
    grows fourfold: its sharpness is 0, whatever it shows. Detail at the finest scale increases it. Flat
    images have 1: nothing shows that they are blurred.
    """
    grey = image.convert("L")
    grey.thumbnail((SHARPNESS_SIDE_PX, SHARPNESS_SIDE_PX), Image.Resampling.LANCZOS, _REDUCING_GAP)
    half = grey.resize((max(2, grey.width // 2), max(2, grey.height // 2)), Image.Resampling.BOX)
    fine, coarse = _gradient_energy(grey), _gradient_energy(half)
    return 1.0 if coarse < 1.0 else max(0.0, min(9.0, 4.0 * fine / coarse - 1.0))


def _gradient_energy(image: Image.Image) -> float:
    values = np.asarray(image, dtype=np.float32)
    down, across = np.diff(values, axis=0), np.diff(values, axis=1)
    return float(np.mean(down**2) + np.mean(across**2)) if min(values.shape) > 1 else 0.0
