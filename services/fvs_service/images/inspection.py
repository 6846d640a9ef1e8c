"""Judging one uploaded file: whether it is a photograph that can be used, and what it tells of itself.

This runs in a child process with limits (see ``inspector``), because it decodes bytes from anywhere.
"""

import hashlib
import io
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
from PIL import Image

from fvs_engine.geometry.priors import PhotographPriors, read_priors
from fvs_engine.images.focal import focal_length_px
from fvs_engine.images.pixels import FORMATS, UnusableImageError, decode
from fvs_service.images.model import ImageWarning, Verdict

SHARP = 0.25
"""Below this ``sharpness`` an image is called blurred: real photographs of ten scenes have 0.5 to 3.0; after
a Gaussian blur of 2 px (of 1024) they have 0.07 to 0.18."""
_SHARPNESS_SIDE_PX = 1024
_REDUCING_GAP = 1.5
"""What is larger still is first halved (thirded, …) in a quick way, down to so many times that size: it takes
half the time, and changes the sharpness by some per cent."""


@dataclass(frozen=True)
class InspectionLimits:
    """What an image may be."""

    max_pixels: int
    min_side_px: int


@dataclass(frozen=True)
class Inspection:
    """What was found; without pixels when they could not be decoded."""

    verdict: Verdict
    reason: str = ""
    hint: str = ""
    warnings: tuple[ImageWarning, ...] = ()
    format: str | None = None
    width_px: int | None = None
    height_px: int | None = None
    focal_length_px: float | None = None
    pixels_sha256: str | None = None
    sharpness: float | None = None
    priors: PhotographPriors = field(default_factory=PhotographPriors)

    @property
    def captured_at(self) -> datetime | None:
        """When the camera says that it took the photograph."""
        return self.priors.captured_at


def inspect(path: Path, limits: InspectionLimits) -> Inspection:
    """Decode the file to its last pixel and judge it; raises nothing that the file's content can cause."""
    content = path.read_bytes()
    if _claims_more_than(limits.max_pixels, content):
        return Inspection(
            Verdict.TOO_LARGE,
            f"It has more than {limits.max_pixels / 1_000_000:g} megapixels.",
            "Scale it down first.",
        )
    try:
        decoded = decode(content)
    except UnusableImageError as error:
        return Inspection(Verdict.UNREADABLE, _sentence(error.message), error.hint)
    image = decoded.rgb
    priors = read_priors(content)
    sharpness = measure_sharpness(image)
    found = Inspection(
        Verdict.ACCEPTED,
        format=decoded.format,
        width_px=image.width,
        height_px=image.height,
        focal_length_px=focal_length_px(decoded.exif, image.width, image.height),
        pixels_sha256=_hash_of_pixels(image),
        sharpness=sharpness,
        warnings=tuple(
            warning
            for warning, applies in (
                (ImageWarning.BLURRED, sharpness < SHARP),
                (ImageWarning.NO_FIX, priors.doubtful),
            )
            if applies
        ),
        priors=priors,
    )
    if min(image.size) < limits.min_side_px:
        return Inspection(
            Verdict.TOO_SMALL,
            f"It has {image.width}×{image.height} px; the shorter side needs {limits.min_side_px} px.",
            "Send the original photograph.",
            format=found.format,
            width_px=image.width,
            height_px=image.height,
        )
    return found


def measure_sharpness(image: Image.Image) -> float:
    """How much an image keeps at its finest scale of what it has at the next coarser one.

    The image is reduced to 1024 px. Where it is smooth, halving it doubles every gradient, so that the
    energy of the gradients grows fourfold: that gives 0, whatever is in the picture. Detail at the finest
    scale gives more. Flat images give 1: nothing shows that they are blurred.
    """
    grey = image.convert("L")
    grey.thumbnail((_SHARPNESS_SIDE_PX, _SHARPNESS_SIDE_PX), Image.Resampling.LANCZOS, _REDUCING_GAP)
    half = grey.resize((max(2, grey.width // 2), max(2, grey.height // 2)), Image.Resampling.BOX)
    fine, coarse = _gradient_energy(grey), _gradient_energy(half)
    return 1.0 if coarse < 1.0 else max(0.0, min(9.0, 4.0 * fine / coarse - 1.0))


def _gradient_energy(image: Image.Image) -> float:
    values = np.asarray(image, dtype=np.float32)
    down, across = np.diff(values, axis=0), np.diff(values, axis=1)
    return float(np.mean(down**2) + np.mean(across**2)) if min(values.shape) > 1 else 0.0


def _claims_more_than(max_pixels: int, content: bytes) -> bool:
    """Whether the file's header promises more pixels; nothing is decoded."""
    try:
        with Image.open(io.BytesIO(content), formats=FORMATS) as image:
            return image.width * image.height > max_pixels
    except Image.DecompressionBombError:
        return True
    except Exception:  # decoding says what is wrong, in better words
        return False


def _hash_of_pixels(image: Image.Image) -> str:
    digest = hashlib.sha256(f"{image.width}x{image.height}".encode())
    digest.update(image.tobytes())
    return digest.hexdigest()


def _sentence(message: str) -> str:
    return message[:1].upper() + message[1:]
