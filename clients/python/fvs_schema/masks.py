"""Where the mask of a photograph is, for the engine and the client."""

from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath

MASKS = "masks"
"""The folder of masks, beside photographs."""
_IMAGES = "images"
"""The folder of photographs beside ``masks``, in datasets of COLMAP and nerfstudio."""


def is_mask(name: str) -> bool:
    """Whether the file of that path below a folder of photographs is a mask."""
    return MASKS in PurePosixPath(name).parts[:-1]


def find_mask(folder: Path, name: str) -> Path | None:
    """The file with the mask of the photograph ``name`` in ``folder``; None without one.

    For ``left/a.jpg`` it is ``a.jpg.png`` or ``a.png`` in ``left/masks`` or ``masks/left``. The masks of a
    folder ``images`` may also be in a folder ``masks`` beside it.
    """
    for place in _places(folder, PurePosixPath(name)):
        for mask in mask_names(place.name, lambda other: (folder / name).with_name(other).is_file()):
            if (file := place.with_name(mask)).is_file():
                return file
    return None


def mask_names(name: str, is_photograph: Callable[[str], bool]) -> Iterator[str]:
    """The names that the mask of the photograph ``name`` may have in a folder of masks, the first one first.

    ``is_photograph``: whether there is a photograph of that name beside it.
    """
    yield f"{name}.png"
    stem = PurePosixPath(name).stem
    # `a.png` is the mask of `a.jpg`, but `a.jpg.png` not that of `a.jpg.tif` where there is an `a.jpg`.
    if not is_photograph(stem):
        yield f"{stem}.png"


def _places(folder: Path, name: PurePosixPath) -> Iterator[Path]:
    """Where masks may be: the paths that they have but for the suffix, the nearest first."""
    for depth in reversed(range(len(name.parts))):
        masks, rest = folder.joinpath(*name.parts[:depth], MASKS), name.parts[depth:]
        yield masks.joinpath(*rest)
        if rest[0] == _IMAGES and len(rest) > 1:
            yield masks.joinpath(*rest[1:])
    if folder.absolute().name == _IMAGES:
        yield folder.absolute().parent / MASKS / name
