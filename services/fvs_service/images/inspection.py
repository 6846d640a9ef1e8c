"""Inspection of one uploaded file: whether it can be used, its properties and its priors.

It runs in a child process with limits (see ``inspector``), because it decodes untrusted bytes.
"""

import hashlib
import io
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from PIL import Image

from fvs_engine.errors import InvalidInputError
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
from fvs_engine.images.pixels import decode, reduced_size
from fvs_engine.images.sharpness import SHARP, measure_sharpness
from fvs_schema.images import ImageWarning, Verdict
from fvs_schema.quantities import MIN_SIDE_PX
from fvs_schema.service import Limits

_BAND_ROWS = 256
"""Rows that are hashed at a time."""
_THUMBNAIL_SIDE_PX = 320
_THUMBNAIL_QUALITY = 80
_REDUCING_GAP = 2.0
"""Larger images are first reduced by an integer factor to at least this multiple: a seventh of the time."""


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
    thumbnail: bytes | None = None
    """A small JPEG of an accepted image, upright."""

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
        return _refused(error)
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
        thumbnail=_thumbnail(image),
    )


def inspect_video(path: Path, limits: ImageLimits, longest_s: float) -> Inspection:
    """Read the header of a video of at most ``longest_s``; no content makes it raise."""
    from fvs_engine.video.reading import open_video

    try:
        with open_video(path) as video:
            size = video.stream.width, video.stream.height
            duration_s = video.duration_s or 0.0
            kind = video.container.format.name.partition(",")[0].upper()
        limits.require(*size, 0)
    except UnusableImageError as error:
        return _refused(error)
    except InvalidInputError as error:
        return Inspection(Verdict.UNREADABLE, error.message.replace(str(path), "It"), error.hint)
    if duration_s > longest_s:
        return Inspection(
            Verdict.TOO_LARGE,
            f"It is {duration_s:.0f} s long, and videos may have {longest_s:.0f} s.",
            "Cut it: ffmpeg -i VIDEO -c copy -f segment -segment_time 1800 -reset_timestamps 1 PART%d.mp4",
        )
    return Inspection(Verdict.VIDEO, format=kind, width_px=size[0], height_px=size[1])


def _refused(error: UnusableImageError) -> Inspection:
    verdict = next(verdict for kind, verdict in _VERDICTS if isinstance(error, kind))
    return Inspection(verdict, _sentence(error.message), error.hint)


@dataclass(frozen=True)
class MaskProblem:
    """Why a mask cannot be used, in the engine's words, and the remedy."""

    reason: str
    hint: str


def inspect_mask(folder: Path, name: str) -> MaskProblem | None:
    """Why the engine cannot use the mask of the image ``name`` in ``folder``; None if it can."""
    try:
        mask_of(folder, name)
    except UnusableImageError as error:
        return MaskProblem(error.message, error.hint)
    return None


def _hash_of_pixels(image: Image.Image) -> str:
    digest = hashlib.sha256(f"{image.width}x{image.height}".encode())
    for top in range(0, image.height, _BAND_ROWS):
        digest.update(image.crop((0, top, image.width, min(top + _BAND_ROWS, image.height))).tobytes())
    return digest.hexdigest()


def _thumbnail(image: Image.Image) -> bytes:
    size = reduced_size(image.width, image.height, _THUMBNAIL_SIDE_PX)
    small = image.resize(size, Image.Resampling.LANCZOS, reducing_gap=_REDUCING_GAP)
    small.info.clear()  # which may have a comment of any length
    out = io.BytesIO()
    small.save(out, "JPEG", quality=_THUMBNAIL_QUALITY)
    return out.getvalue()


def _sentence(message: str) -> str:
    return message[:1].upper() + message[1:]
