"""Checks of the image files of a growing reconstruction."""

from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.sfm.growing.state import GrowthState


def require_unchanged(state: GrowthState, image_dir: Path, names: Sequence[str]) -> dict[str, int]:
    """Sizes in bytes of ``names``; raises ``InvalidInputError`` when a file is missing or has changed."""
    sizes = {}
    for name in names:
        file = image_dir / name
        if not file.is_file():
            raise InvalidInputError(f"{file} does not exist.", hint="Check the image names.")
        sizes[name] = file.stat().st_size
        if state.images.get(name, sizes[name]) != sizes[name]:
            raise InvalidInputError(
                f"{file} is not the photograph that was added before.",
                hint="Give the new photograph a name of its own, or start in another folder.",
            )
    return sizes


def require_readable(image_dir: Path, names: Sequence[str]) -> None:
    """Raise ``InvalidInputError`` for what is no image, before it becomes part of the state."""
    for name in names:
        try:
            with Image.open(image_dir / name):
                pass
        except (OSError, Image.DecompressionBombError) as error:
            raise InvalidInputError(
                f"{image_dir / name} cannot be read as an image.", hint="Leave it out, or export it again."
            ) from error
