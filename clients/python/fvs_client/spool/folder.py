"""The photographs in a folder that a camera writes to."""

import os
import re
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvs_client.image_files import SUFFIXES, UNREADABLE_SUFFIXES, scene_name
from fvs_schema.masks import MASKS


@dataclass(frozen=True, slots=True)
class FoundFile:
    """A file as it is now; ``sidecar`` is its JSON file, ``sidecar_state`` that file's size and time.

    Of text: a folder may have thousands, and a ``Path`` takes a kilobyte.
    """

    location: str
    name: str
    size_bytes: int
    mtime_ns: int
    sidecar: str | None
    sidecar_state: str

    @property
    def path(self) -> Path:
        """Where the file is."""
        return Path(self.location)

    @property
    def readable(self) -> bool:
        """Whether the service reads its format."""
        return os.path.splitext(self.location)[1].lower() in SUFFIXES  # noqa: PTH122


def find_files(folder: Path) -> list[FoundFile]:
    """The image files in and below a folder, except hidden ones and masks, in their order.

    Raises as ``each_file``.
    """
    return sorted(each_file(folder), key=order_of)


def each_file(folder: Path, skipped: Callable[[OSError], None] = lambda _: None) -> Iterator[FoundFile]:
    """The same files one by one, in no order: a folder may have more than there is memory for.

    Raises ``OSError`` when the folder cannot be read; folders in it that cannot, such as ``lost+found``, are
    ``skipped``.
    """
    return _below(folder, (), skipped)


def order_of(file: FoundFile) -> list[tuple[int, str]]:
    """Sorts files by their numbers: ``DJI_0009`` before ``DJI_0010`` and ``DJI_10000``.

    Not by time: a camera's clock jumps when it first receives satellites.
    """
    parts = re.split(r"(\d+)", file.location)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def find_file(path: Path) -> FoundFile:
    """One file, by its own path. Raises ``OSError``."""
    status = path.stat()
    state: tuple[str | None, str] = (None, "")
    for sidecar in (path.with_name(f"{path.name}.json"), path.with_suffix(".json")):
        if sidecar.is_file():
            state = (str(sidecar), _state(sidecar.stat()))
            break
    return FoundFile(str(path), scene_name([path.name]), status.st_size, status.st_mtime_ns, *state)


def _below(
    folder: Path | str, parts: Sequence[str], skipped: Callable[[OSError], None]
) -> Iterator[FoundFile]:
    with os.scandir(folder) as entries:
        sidecars = {entry.name for entry in entries if entry.name.endswith(_SIDECAR)}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                continue
            try:
                if entry.is_dir(follow_symlinks=False):
                    if entry.name == MASKS:
                        continue
                    yield from _below(entry.path, (*parts, entry.name), skipped)
                elif _is_wanted(entry.path) and entry.is_file():
                    yield _found(entry, (*parts, entry.name), sidecars)
            except FileNotFoundError:  # gone since it was listed
                continue
            except OSError as error:
                skipped(error)


def _is_wanted(location: str) -> bool:
    """Whether a file is an image; a raw file beside its JPEG, which is sent, is not."""
    stem, suffix = os.path.splitext(location)  # noqa: PTH122 -- of every file, once a second
    if suffix.lower() in UNREADABLE_SUFFIXES:
        return not any(os.path.exists(f"{stem}{other}") for other in _BESIDE_RAW)  # noqa: PTH110
    return suffix.lower() in SUFFIXES


def _found(entry: os.DirEntry[str], parts: Sequence[str], sidecars: Container[str]) -> FoundFile:
    status = entry.stat()
    sidecar, sidecar_state = None, ""
    for name in (f"{entry.name}{_SIDECAR}", f"{os.path.splitext(entry.name)[0]}{_SIDECAR}"):  # noqa: PTH122
        if name in sidecars:
            sidecar = f"{entry.path.removesuffix(entry.name)}{name}"
            sidecar_state = _state(os.stat(sidecar))  # noqa: PTH116
            break
    return FoundFile(
        entry.path, scene_name(parts), status.st_size, status.st_mtime_ns, sidecar, sidecar_state
    )


_SIDECAR = ".json"
_BESIDE_RAW = (".jpg", ".JPG", ".jpeg", ".JPEG")


def _state(status: os.stat_result) -> str:
    return f"{status.st_size}:{status.st_mtime_ns}"
