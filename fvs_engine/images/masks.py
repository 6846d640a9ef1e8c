"""Masks: which pixels of a photograph count; the others move, or are not wanted.

A mask is a PNG of the photograph's size in which black is left out, as COLMAP and nerfstudio have it; in a
photograph with transparency, what is not opaque is left out, too. A mask in memory is a bool [H, W], True
where the photograph counts, and None where all of it does.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fvs_engine.images.limits import UnusableImageError
from fvs_engine.images.pixels import LAST_OF_SAME_SIDES, orientation_of, size_as_stored, turned_as_asked
from fvs_engine.images.unreadable import FORMATS
from fvs_schema.masks import find_mask

Mask = NDArray[np.bool_]

_WHITE = np.uint8(255)
_SIZE_HINT = "Make the mask of the photograph in its full size, or delete it."


def read_mask(folder: Path, name: str, file: Path | None = None, *, turn: bool = False) -> Mask | None:
    """The mask of the photograph ``name`` in ``folder``, as ``mask_of`` has it.

    Raises ``UnusableImageError``, naming the photograph.
    """
    try:
        return mask_of(folder, name, file, turn=turn)
    except UnusableImageError as error:
        path = folder / name
        raise UnusableImageError(
            f"{path} cannot be used: {error.message}", hint=error.hint, path=path
        ) from error


def mask_of(folder: Path, name: str, file: Path | None = None, *, turn: bool = False) -> Mask | None:
    """The mask of the photograph ``name`` in ``folder``: of its file and its transparency.

    Its file is what ``find_mask`` finds, else ``file``. The mask is that of the stored pixels, or with
    ``turn`` that of the upright ones. A file has that of the stored pixels, or that of the upright ones where
    the two sizes differ and it has theirs. Raises ``UnusableImageError`` when it cannot be read, has another
    size or leaves out everything.
    """
    found = _read(folder / name, find_mask(folder, name) or file, turn)
    if found is not None and not found.any():
        raise UnusableImageError(
            "its mask leaves out every pixel.",
            hint="In a mask black is left out, and white is kept: was it inverted?",
        )
    return None if found is None or found.all() else found


def reduced_mask(mask: Mask, size: tuple[int, int]) -> Mask:
    """The mask at a smaller ``size`` (width, height).

    A pixel counts where all of the pixels do that it is made of.
    """
    grey = Image.fromarray(mask.astype(np.uint8) * _WHITE)
    return np.asarray(np.asarray(grey.resize(size, Image.Resampling.BOX)) == _WHITE)


def write_mask(mask: Mask, file: Path) -> None:
    """Write the mask as a PNG; raises ``OSError``."""
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(mask.astype(np.uint8) * _WHITE).save(file, format="PNG")


def _read(photograph: Path, file: Path | None, turn: bool) -> Mask | None:
    with Image.open(photograph, formats=FORMATS) as image:
        transparent = image.has_transparency_data and not image.mode.startswith("I;16")
        if file is None and not transparent:
            return None
        orientation, is_turned = orientation_of(image), image.format == "TIFF"  # Pillow turns it
        stored = size_as_stored(image)
        opaque = image.convert("RGBA").getchannel("A") if transparent else None
    if opaque is not None:
        opaque = turned_as_asked(opaque, orientation, is_upright=is_turned, turn=turn)
    opaque_pixels = None if opaque is None else np.asarray(opaque) == _WHITE
    in_file = None
    if file is not None:
        of_stored = _of_file(file, stored, orientation)
        in_file = np.asarray(turned_as_asked(of_stored, orientation, is_upright=False, turn=turn)) > 0
    if opaque_pixels is None or in_file is None:
        return in_file if opaque_pixels is None else opaque_pixels
    return np.asarray(opaque_pixels & in_file)


def _of_file(file: Path, stored: tuple[int, int], orientation: int) -> Image.Image:
    """The mask in ``file`` of the stored pixels of a photograph, which have the size ``stored``."""
    named = f"its mask {file.parent.name}/{file.name}"
    try:
        with Image.open(file, formats=("PNG",)) as image:
            size = image.size
            if size not in (stored, stored[::-1] if orientation > LAST_OF_SAME_SIDES else stored):
                raise UnusableImageError(
                    f"{named} has {size[0]}×{size[1]} px, the photograph {stored[0]}×{stored[1]} px.",
                    hint=_SIZE_HINT,
                )
            grey = image.convert("L")
    except UnusableImageError:
        raise
    except Image.DecompressionBombError as error:
        raise UnusableImageError(f"{named} has more pixels than any photograph.", hint=_SIZE_HINT) from error
    except Exception as error:  # damaged bytes can make the decoder raise anything
        raise UnusableImageError(
            f"{named} cannot be read as a PNG.", hint="Save it as PNG again, or delete it."
        ) from error
    return turned_as_asked(grey, orientation, is_upright=size != stored, turn=False)
