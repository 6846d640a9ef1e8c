"""Catalogue of the photographs in a folder, and of rejected files with the reasons."""

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.folders import require_folder
from fvs_engine.images.focal import focal_length_px
from fvs_engine.images.limits import ImageLimits, UnusableImageError
from fvs_engine.images.masks import mask_of
from fvs_engine.images.names import match_names
from fvs_engine.images.pixels import decode
from fvs_engine.monitor import Monitor
from fvs_schema.masks import find_mask, is_mask
from fvs_schema.names import readable_name
from fvs_schema.quantities import MIN_SIDE_PX
from fvs_schema.stages import Stage

SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".mpo", ".png", ".tif", ".tiff", ".webp", ".bmp"})
UNREADABLE_SUFFIXES = frozenset(
    {
        ".heic",
        ".heif",
        ".avif",
        ".jxl",
        ".jp2",
        ".gif",
        ".exr",
        ".dng",
        ".cr2",
        ".cr3",
        ".nef",
        ".arw",
        ".orf",
    }
    | {".rw2", ".raf", ".pef", ".srw"}
)
"""Suffixes of photographs in formats that are not supported: reported, not ignored."""

_LIMITS = ImageLimits(min_side_px=MIN_SIDE_PX)


@dataclass(frozen=True)
class Photograph:
    """A photograph that decodes to its last pixel.

    ``name`` is the ``readable_name`` of its posix path below the folder; the size is that of the upright
    image; ``focal_px`` is EXIF's focal length in px, None without one; ``plain``: the file needs no
    conversion (8 bits, upright, JPEG or PNG); ``format`` is that of the content, whatever the suffix;
    ``turned``: its EXIF says that the stored pixels are not upright. ``masked``: not all of it counts;
    ``mask`` is the file with its mask, None without one.
    """

    path: Path
    name: str
    width_px: int
    height_px: int
    sha256: str
    focal_px: float | None
    format: str
    plain: bool
    turned: bool
    masked: bool
    mask: Path | None


@dataclass(frozen=True)
class RejectedImage:
    """A file that is not used: ``reason`` is a sentence about it, ``hint`` the remedy."""

    name: str
    reason: str
    hint: str


@dataclass(frozen=True)
class ImageCatalog:
    """The photographs of a folder and what was left out; each sorted by name.

    ``ignored`` are files with other suffixes.
    """

    folder: Path
    photographs: tuple[Photograph, ...]
    rejected: tuple[RejectedImage, ...]
    ignored: tuple[str, ...]


def catalog_images(
    folder: Path,
    *,
    leave_out: Path | None = None,
    masks: Mapping[str, Path | None] | None = None,
    monitor: Monitor | None = None,
    threads: int | None = None,
) -> ImageCatalog:
    """Decode every image below ``folder`` and separate the usable ones from the rest.

    Subfolders are searched; hidden files and folders are not, nor is the folder ``leave_out``. What is in a
    folder ``masks`` is no photograph, and rejected where it is the mask of none. ``masks``: name of a
    photograph, as ``match_names`` reads it → the file with its mask, if any, which counts where the folder
    has none for it; these files are no photographs either. Of files with the same content the first by name
    is kept. Progress is reported as stage ``images``. Raises ``InvalidInputError`` when ``folder`` is not a
    readable folder, and for an ambiguous name in ``masks``; ``Cancelled``.
    """
    monitor = monitor or Monitor()
    candidates: dict[str, Path] = {}
    rejected: list[RejectedImage] = []
    ignored: list[str] = []
    given = {file.resolve() for file in (masks or {}).values() if file is not None}
    in_folders: dict[Path, str] = {}
    for name, path in _named_files(folder, leave_out):
        suffix = path.suffix.lower()
        if given and path.resolve() in given:
            continue
        if is_mask(name) and suffix in SUFFIXES:
            in_folders[path] = name
        elif suffix in SUFFIXES and name in candidates:
            reason = "another file has this name, if bytes that are not UTF-8 are written like this."
            rejected.append(RejectedImage(name, reason, "Rename one of the two."))
        elif suffix in SUFFIXES:
            candidates[name] = path
        elif suffix in UNREADABLE_SUFFIXES:
            reason = f"{suffix[1:].upper()} files are not read here."
            rejected.append(RejectedImage(name, reason, "Export it as JPEG or PNG."))
        else:
            ignored.append(name)

    first_with: dict[str, str] = {}
    photographs: list[Photograph] = []
    files = _masked(candidates, masks or {})
    for result in _examined(folder, files, monitor, threads):
        if isinstance(result, RejectedImage):
            rejected.append(result)
        elif result.sha256 in first_with:
            reason = f"it is the same file as {first_with[result.sha256]}."
            rejected.append(RejectedImage(result.name, reason, "Delete one of the two."))
        else:
            first_with[result.sha256] = result.name
            photographs.append(result)
    used = {find_mask(folder, _below(folder, path)) for path in files} if in_folders else set()
    for path, name in in_folders.items():
        if path not in used:
            reason = "it is in a folder of masks, and the mask of no photograph."
            hint = "The mask of a.jpg is masks/a.png or masks/a.jpg.png. Move photographs to another folder."
            rejected.append(RejectedImage(name, reason, hint))
    rejected.sort(key=lambda image: image.name)
    return ImageCatalog(folder, tuple(photographs), tuple(rejected), tuple(ignored))


def require_usable(
    folder: Path, names: Sequence[str], masks: Mapping[str, Path], *, monitor: Monitor | None = None
) -> None:
    """Check that all images ``names`` of ``folder`` can be decoded, and their masks used.

    ``masks``: name → the file that counts where the folder has no mask. Stage ``images``. Raises
    ``InvalidInputError`` for the first that cannot be used, ``Cancelled``.
    """
    files = {folder / name: masks.get(name) for name in names}
    for result in _examined(folder, files, monitor or Monitor(), None):
        if isinstance(result, RejectedImage):
            raise InvalidInputError(
                f"{folder / result.name} cannot be used: {result.reason}",
                hint=result.hint,
                path=folder / result.name,
            )


def _masked(candidates: Mapping[str, Path], masks: Mapping[str, Path | None]) -> dict[Path, Path | None]:
    """Each of the ``candidates`` → the one of the ``masks`` that is given for it, if any."""
    matches = match_names(masks, {name: name for name in candidates})
    matches.require_unambiguous()
    given = {candidates[name]: masks[given_name] for given_name, name in matches.found.items()}
    return {path: given.get(path) for path in candidates.values()}


def _examined(
    folder: Path, files: Mapping[Path, Path | None], monitor: Monitor, threads: int | None
) -> Iterator[Photograph | RejectedImage]:
    """The photograph or rejection of each of the ``files`` below ``folder``, in their order.

    Each has the mask that is given for it.
    """
    executor = ThreadPoolExecutor(threads or os.cpu_count() or 1)
    try:
        results = executor.map(lambda path: _examine(folder, path, files[path]), files)
        for done, result in enumerate(results, start=1):
            yield result
            monitor.report(Stage.IMAGES, done, len(files))
            monitor.check()
    finally:
        executor.shutdown(cancel_futures=True)


def _named_files(folder: Path, leave_out: Path | None) -> list[tuple[str, Path]]:
    """Readable name and path of each file, sorted by name."""
    require_folder(folder, "Give the folder that holds the photographs.")
    paths = _walk(folder, leave_out.resolve() if leave_out else None)
    return sorted((readable_name(_below(folder, path)), path) for path in paths)


def _below(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _walk(folder: Path, leave_out: Path | None) -> Iterator[Path]:
    def stop(error: OSError) -> None:
        raise InvalidInputError(
            f"The folder {error.filename} cannot be read: {error.strerror}.",
            hint="Check its permissions.",
            path=error.filename,
        ) from error

    for parent, subfolders, files in os.walk(folder, onerror=stop):
        subfolders[:] = [
            name
            for name in subfolders
            if not name.startswith(".") and Path(parent, name).resolve() != leave_out
        ]
        for name in files:
            if not name.startswith("."):
                yield Path(parent, name)


def _examine(folder: Path, path: Path, mask: Path | None) -> Photograph | RejectedImage:
    own_name = _below(folder, path)
    name = readable_name(own_name)
    try:
        content = path.read_bytes()
        image = decode(content, _LIMITS)
        masked = mask_of(folder, own_name, mask) is not None
    except UnusableImageError as error:
        return RejectedImage(name, readable_name(error.message), error.hint)
    except OSError as error:
        return RejectedImage(
            name, f"it cannot be read: {error.strerror}.", "Check the file and its permissions."
        )
    width, height = image.rgb.size
    return Photograph(
        path=path,
        name=name,
        width_px=width,
        height_px=height,
        sha256=hashlib.sha256(content).hexdigest(),
        focal_px=focal_length_px(image.exif, width, height),
        format=image.format,
        plain=image.plain,
        turned=image.turned,
        masked=masked,
        mask=find_mask(folder, own_name) or mask,
    )
