"""Find the image files of an upload."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from fvs_schema.masks import find_mask, is_mask
from fvs_schema.names import readable_name
from fvs_schema.videos import VIDEO_SUFFIXES, find_subtitles, is_video

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]

SUFFIXES = VIDEO_SUFFIXES | {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".mpo", ".bmp"}
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


@dataclass(frozen=True)
class ImageFile:
    """A file and its name in the scene; ``readable``: whether the service reads its format.

    ``mask``: the file with its mask, None without one. ``is_unused_mask``: the file is in a folder of masks,
    and the mask of no image.
    """

    path: Path
    name: str
    readable: bool = True
    mask: Path | None = None
    is_unused_mask: bool = False

    @property
    def sent(self) -> bool:
        """Whether it is an image that is sent."""
        return self.readable and not self.is_unused_mask

    @property
    def subtitles(self) -> Path | None:
        """The file with a video's subtitles; None without one."""
        return find_subtitles(self.path) if is_video(self.name) else None


def find_image_files(paths: Paths) -> list[ImageFile]:
    """The image files in ``paths``, each once, sorted within each folder.

    A folder means all images and videos in and below it except hidden ones; names keep the folders in between
    (``left_0001.jpg``). Files in a folder ``masks`` are no images, but their masks (see ``find_mask``); those
    of no image come last.
    Raises ``FileNotFoundError`` for a path that does not exist.
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
        if file.suffix.lower() in SUFFIXES | UNREADABLE_SUFFIXES
        and not any(part.startswith(".") for part in file.relative_to(folder).parts)
        and file.is_file()
    )
    images = [
        ImageFile(
            folder / file,
            scene_name(file.parts),
            file.suffix.lower() in SUFFIXES,
            find_mask(folder, file.as_posix()),
        )
        for file in inside
        if not is_mask(file.as_posix())
    ]
    used = {image.mask for image in images}
    masks = [file for file in inside if is_mask(file.as_posix()) and folder / file not in used]
    return images + [ImageFile(folder / file, scene_name(file.parts), is_unused_mask=True) for file in masks]


def _named(path: Path) -> ImageFile:
    return ImageFile(path, scene_name([path.name]), mask=find_mask(path.parent, path.name))


def scene_name(parts: Sequence[str]) -> str:
    """The name in the scene of the file with these parts of its path below the folder that was given.

    One that the service accepts: readable, without control characters, not too long.
    """
    return re.sub(r"[\x00-\x1f\x7f/\\]", "_", readable_name("_".join(parts)))[-_LONGEST_NAME:]
