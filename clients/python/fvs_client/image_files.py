"""Find the image files of an upload."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from fvs_schema.names import readable_name

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".mpo", ".bmp"})
"""Files of a folder that are uploaded; a file given by its own path is always uploaded."""

UNREADABLE_SUFFIXES = frozenset(
    {
        ".heic",
        ".heif",
        ".avif",
        ".jxl",
        ".jp2",
        ".dng",
        ".cr2",
        ".cr3",
        ".nef",
        ".arw",
        ".orf",
        ".rw2",
        ".raf",
    }
)
"""Formats that the service does not read; such files of a folder are reported as failed."""

_LONGEST_NAME = 255
_IMAGES, MASKS = "images", "masks"


@dataclass(frozen=True)
class ImageFile:
    """A file and its name in the scene; ``readable``: whether the service reads its format.

    ``mask``: the file with its mask, None without one.
    """

    path: Path
    name: str
    readable: bool = True
    mask: Path | None = None


def find_image_files(paths: Paths) -> list[ImageFile]:
    """The image files in ``paths``, each once, sorted within each folder.

    A folder means all images in and below it except hidden ones; names keep the folders in between
    (``left_0001.jpg``). Files in a folder ``masks`` are no images, but their masks (see ``mask_of``). Raises
    ``FileNotFoundError`` for a path that does not exist.
    """
    listed = [paths] if isinstance(paths, str | PathLike) else list(paths)
    found: dict[Path, ImageFile] = {}
    for path in map(Path, listed):
        if not path.exists():
            raise FileNotFoundError(f"{path} does not exist.")
        for file in _files_in(path) if path.is_dir() else [_named(path)]:
            found.setdefault(file.path, file)
    return list(found.values())


def _files_in(folder: Path) -> list[ImageFile]:
    inside = sorted(
        file.relative_to(folder)
        for file in folder.rglob("*")
        if file.suffix.lower() in SUFFIXES | UNREADABLE_SUFFIXES and file.is_file()
    )
    return [
        ImageFile(
            folder / file, scene_name(file.parts), file.suffix.lower() in SUFFIXES, mask_of(folder, file)
        )
        for file in inside
        if MASKS not in file.parts[:-1] and not any(part.startswith(".") for part in file.parts)
    ]


def _named(path: Path) -> ImageFile:
    return ImageFile(path, scene_name([path.name]), mask=mask_of(path.parent, Path(path.name)))


def mask_of(folder: Path, file: Path) -> Path | None:
    """The mask of ``file`` in ``folder``, where the engine finds those of its photographs; None without one.

    For ``left/a.jpg`` it is ``a.jpg.png`` or ``a.png`` in ``left/masks`` or ``masks/left``. The masks of a
    folder ``images`` may also be in a folder ``masks`` beside it.
    """
    places = []
    for depth in reversed(range(len(file.parts))):
        masks, rest = folder.joinpath(*file.parts[:depth], MASKS), file.parts[depth:]
        places.append(masks.joinpath(*rest))
        if rest[0] == _IMAGES and len(rest) > 1:
            places.append(masks.joinpath(*rest[1:]))
    if folder.absolute().name == _IMAGES:
        places.append(folder.absolute().parent / MASKS / file)
    found = (
        mask for place in places for mask in (place.with_name(f"{place.name}.png"), place.with_suffix(".png"))
    )
    return next((mask for mask in found if mask.is_file()), None)


def scene_name(parts: Sequence[str]) -> str:
    """The name in the scene of the file with these parts of its path below the folder that was given.

    One that the service accepts: readable, without control characters, not too long.
    """
    return re.sub(r"[\x00-\x1f\x7f/\\]", "_", readable_name("_".join(parts)))[-_LONGEST_NAME:]
