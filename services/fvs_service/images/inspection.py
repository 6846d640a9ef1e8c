"""Inspection of one uploaded file: whether it can be used, its properties and its priors.

It runs in a child process with limits (see ``inspector``), because it decodes untrusted bytes.
"""

import hashlib
import io
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
from PIL import Image

from fvs_engine.images.focal import focal_length_px
from fvs_engine.images.limits import (
    ImageLimits,
    TooLargeError,
    TooNarrowError,
    TooSmallError,
    UnusableImageError,
)
from fvs_engine.images.masks import mask_of
from fvs_engine.images.metadata import PhotographPriors, read_priors
from fvs_engine.images.pixels import decode
from fvs_schema.images import ImageWarning, Verdict
from fvs_schema.quantities import MIN_SIDE_PX
from fvs_schema.service import Limits

SHARP = 0.25
"""Images below this ``sharpness`` are blurred: photographs of ten scenes have 0.5 to 3.0, and 0.07 to 0.18
after a Gaussian blur of 2 px (of 1024)."""
_SHARPNESS_SIDE_PX = 1024
_REDUCING_GAP = 1.5
"""Larger images are first reduced by an integer factor to at least this multiple of that size: this halves
the time, and changes the sharpness by a few per cent."""
_BAND_ROWS = 256
"""Rows that are hashed at a time."""


def image_limits(limits: Limits) -> ImageLimits:
    """The limits of one image."""
    return ImageLimits(
        max_pixels=limits.image_pixels,
        min_side_px=MIN_SIDE_PX,
        max_decoding_bytes=limits.image_decoding_bytes,
    )


_VERDICTS: tuple[tuple[type[UnusableImageError], Verdict], ...] = (
    (TooLargeError, Verdict.TOO_LARGE),
    (TooSmallError, Verdict.TOO_SMALL),
    (TooNarrowError, Verdict.TOO_NARROW),
    (UnusableImageError, Verdict.UNREADABLE),
)


@dataclass(frozen=True)
class Inspection:
    """The verdict on a file, and its properties as far as it could be decoded."""

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
        """The capture time in the file's metadata."""
        return self.priors.captured_at


def inspect(path: Path, limits: ImageLimits) -> Inspection:
    """Decode the whole file and return the verdict; no content makes it raise."""
    content = path.read_bytes()
    try:
        decoded = decode(content, limits)
    except UnusableImageError as error:
        verdict = next(verdict for kind, verdict in _VERDICTS if isinstance(error, kind))
        return Inspection(verdict, _sentence(error.message), error.hint)
    image = decoded.rgb
    priors = read_priors(io.BytesIO(content))
    sharpness = measure_sharpness(image)
    return Inspection(
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
                (ImageWarning.POSITION_IGNORED, priors.doubtful),
            )
            if applies
        ),
        priors=priors,
    )


@dataclass(frozen=True)
class MaskProblem:
    """Why a mask cannot be used, as a sentence, and the remedy."""

    reason: str
    hint: str


def inspect_mask(folder: Path, name: str) -> MaskProblem | None:
    """Why the engine cannot use the mask of the image ``name`` in ``folder``; None if it can."""
    try:
        mask_of(folder, name)
    except UnusableImageError as error:
        return MaskProblem(_sentence(error.message), error.hint)
    return None


def measure_sharpness(image: Image.Image) -> float:
    """The gradient energy of an image at its finest scale relative to the next coarser one.

    The image is reduced to 1024 px. In a smooth image halving doubles every gradient, so that their energy
    grows fourfold: its sharpness is 0, whatever it shows. Detail at the finest scale increases it. Flat
    images have 1: nothing shows that they are blurred.
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


def _hash_of_pixels(image: Image.Image) -> str:
    digest = hashlib.sha256(f"{image.width}x{image.height}".encode())
    for top in range(0, image.height, _BAND_ROWS):
        digest.update(image.crop((0, top, image.width, min(top + _BAND_ROWS, image.height))).tobytes())
    return digest.hexdigest()


def _sentence(message: str) -> str:
    return message[:1].upper() + message[1:]
