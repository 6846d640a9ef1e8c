"""Which files an upload means."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".mpo", ".bmp"})
"""What is taken of a folder; a file that is named itself is always sent."""

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
"""Photographs of formats that the service does not read: in a folder they are named, not passed over."""

_LONGEST_NAME = 255


@dataclass(frozen=True)
class Photograph:
    """A file, and what the service will call it; only what is ``readable`` is worth sending."""

    path: Path
    name: str
    readable: bool = True


def find_photographs(paths: Paths) -> list[Photograph]:
    """The photographs that ``paths`` mean, sorted within each folder, each once.

    A folder means every photograph in and below it, without hidden ones; in its name the folders between are
    kept (``left_0001.jpg``). Raises ``FileNotFoundError`` for a path that does not exist.
    """
    listed = [paths] if isinstance(paths, str | PathLike) else list(paths)
    found: dict[Path, Photograph] = {}
    for path in map(Path, listed):
        if not path.exists():
            raise FileNotFoundError(f"{path} does not exist.")
        for photograph in _files_in(path) if path.is_dir() else [Photograph(path, _sendable(path.name))]:
            found.setdefault(photograph.path, photograph)
    return list(found.values())


def _files_in(folder: Path) -> list[Photograph]:
    inside = sorted(
        file.relative_to(folder)
        for file in folder.rglob("*")
        if file.suffix.lower() in SUFFIXES | UNREADABLE_SUFFIXES and file.is_file()
    )
    return [
        Photograph(folder / file, _sendable("_".join(file.parts)), file.suffix.lower() in SUFFIXES)
        for file in inside
        if not any(part.startswith(".") for part in file.parts)
    ]


def _sendable(name: str) -> str:
    """A name that the service takes: no control characters, no undecodable bytes, not too long."""
    readable = name.encode("utf-8", errors="replace").decode()
    return re.sub(r"[\x00-\x1f\x7f/\\]", "_", readable)[-_LONGEST_NAME:]
