"""The focal length in px from EXIF."""

import math
from collections.abc import Mapping
from typing import Any

from PIL import Image

from fvs_schema.quantities import PLAUSIBLE_SHARE

_EXIF_IFD = 0x8769
_FOCAL_LENGTH_MM = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_PLANE_X_RESOLUTION = 0xA20E
_PLANE_RESOLUTION_UNIT = 0xA210
_PIXEL_DIMENSIONS = (0xA002, 0xA003)

_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)


def focal_length_px(exif: Image.Exif, width_px: int, height_px: int) -> float | None:
    """Focal length in px of an image of ``width_px`` × ``height_px``, either way up; None when unknown.

    From the 35 mm equivalent, which CIPA DC-008 defines by the image's diagonal; else from the focal
    length and the sensor's resolution. That resolution is the camera's, so it is scaled when the image
    has been resized since (``PixelXDimension`` and ``PixelYDimension`` are its original size).
    """
    try:
        tags: Mapping[int, Any] = exif.get_ifd(_EXIF_IFD)
    except Exception:  # damaged metadata counts as none
        return None
    equivalent_mm = _number(tags.get(_FOCAL_LENGTH_35MM))
    if equivalent_mm is not None:
        focal = equivalent_mm * math.hypot(width_px, height_px) / _FULL_FRAME_DIAGONAL_MM
    else:
        length_mm = _number(tags.get(_FOCAL_LENGTH_MM))
        resolution = _number(tags.get(_PLANE_X_RESOLUTION))
        unit_mm = _UNIT_MM.get(tags.get(_PLANE_RESOLUTION_UNIT, 2))
        if length_mm is None or resolution is None or unit_mm is None:
            return None
        long_side = max(width_px, height_px)
        original = max((_number(tags.get(tag)) or 0.0 for tag in _PIXEL_DIMENSIONS), default=0.0)
        focal = length_mm * resolution / unit_mm * long_side / (original or long_side)
    share = focal / max(width_px, height_px)
    return focal if PLAUSIBLE_SHARE[0] <= share <= PLAUSIBLE_SHARE[1] else None


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None
