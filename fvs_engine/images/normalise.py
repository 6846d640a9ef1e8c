"""Normalisation of photographs: upright unless their cameras are given, 8-bit, JPEG or PNG."""

import contextlib
import io
import os
import re
import shutil
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from urllib.parse import quote

from PIL import Image
from PIL.ExifTags import Base
from PIL.PngImagePlugin import PngInfo

from fvs_engine.images.catalog import Photograph
from fvs_engine.images.embedded import read_embedded
from fvs_engine.images.masks import read_mask, write_mask
from fvs_engine.images.pixels import decode
from fvs_engine.monitor import Monitor
from fvs_schema.masks import MASKS
from fvs_schema.names import readable_name
from fvs_schema.stages import Stage

_SUFFIXES = {"JPEG": (".jpg", ".jpeg", ".jpe"), "MPO": (".jpg", ".jpeg", ".jpe"), "PNG": (".png",)}
_UNSAFE = re.compile(r"[\s#%]")
_JPEG_QUALITY = 98
_XMP_IN_JPEG = 65_000
"""The bytes of XMP that a segment of JPEG holds."""


def normalised_name(photograph: Photograph) -> str:
    """The name of ``photograph`` in the normalised folder.

    Its own, unless its suffix does not fit the file's format; then the right one is appended:
    ``scan.tif`` becomes ``scan.tif.png`` and cannot collide with a ``scan.png``. White space and ``#``, which
    COLMAP's text files cannot hold, are escaped as in a URL: ``IMG (1).jpg`` becomes ``IMG%20(1).jpg``. Bytes
    that are not UTF-8 become what they are in its ``readable_name``.
    """
    name = readable_name(_UNSAFE.sub(lambda found: quote(found[0], safe=""), _own_name(photograph)))
    target = photograph.format if photograph.plain or photograph.format in ("JPEG", "MPO") else "PNG"
    suffixes = _SUFFIXES[target]
    if PurePosixPath(name).suffix.lower() in suffixes:
        return name
    return name + suffixes[0]


def normalise_images(
    photographs: Sequence[Photograph],
    folder: Path,
    *,
    as_stored: Collection[str] = (),
    monitor: Monitor | None = None,
    threads: int | None = None,
) -> Mapping[str, Path]:
    """Fill ``folder`` with the photographs, and return normalised name → path in the order given.

    Their masks go to the folder ``masks`` beside it, where ``find_mask`` finds them.

    A plain file is hard-linked (copied where that is not possible), so that its metadata and its bytes
    survive. Another one is decoded and encoded again with its EXIF, without the orientation, and its XMP:
    JPEG (quality 98, full chroma) if it was lossy already, else PNG. Photographs whose normalised names are
    in ``as_stored`` are not turned upright. Existing files are kept, so that an interrupted call can be
    repeated. Progress is reported as stage ``normalise``. Raises ``OSError`` when
    the folder cannot be written, ``Cancelled``.
    """
    monitor = monitor or Monitor()
    paths = {normalised_name(photograph): folder / normalised_name(photograph) for photograph in photographs}
    for parent in {path.parent for path in paths.values()} | {folder}:
        parent.mkdir(parents=True, exist_ok=True)
    executor = ThreadPoolExecutor(threads or os.cpu_count() or 1)
    try:
        turn = [name not in as_stored for name in paths]
        for done, _ in enumerate(executor.map(_write_both, photographs, paths.items(), turn), start=1):
            monitor.report(Stage.NORMALISE, done, len(photographs))
            monitor.check()
    finally:
        executor.shutdown(cancel_futures=True)
    return paths


def _write_both(photograph: Photograph, normalised: tuple[str, Path], turn: bool) -> None:
    name, path = normalised
    _write(photograph, path, turn)
    file = _folder_of(path, name).with_name(MASKS) / f"{name}.png"
    mask = None
    if photograph.masked:
        source = _folder_of(photograph.path, photograph.name)
        mask = read_mask(source, _own_name(photograph), photograph.mask, turn=turn)
    if mask is None:
        file.unlink(missing_ok=True)
    else:
        write_mask(mask, file)


def _folder_of(path: Path, name: str) -> Path:
    """The folder in which ``path`` has this name."""
    return path.parents[len(PurePosixPath(name).parts) - 1]


def _own_name(photograph: Photograph) -> str:
    """The path of a photograph below the folder of photographs, with the bytes that it has there."""
    return photograph.path.relative_to(_folder_of(photograph.path, photograph.name)).as_posix()


def _write(photograph: Photograph, path: Path, turn: bool) -> None:
    if path.exists():
        return
    temporary = path.with_name(f".{path.name}.partial")
    temporary.unlink(missing_ok=True)
    try:
        if photograph.plain:
            _link_or_copy(photograph.path, temporary)
        else:
            _encode_again(photograph, temporary, path.suffix.lower(), turn=turn)
        temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def _link_or_copy(source: Path, target: Path) -> None:
    try:
        target.hardlink_to(source.resolve())
    except OSError:  # another file system, or one without hard links, or another user's file
        shutil.copyfile(source, target)


def _encode_again(photograph: Photograph, target: Path, suffix: str, *, turn: bool) -> None:
    content = photograph.path.read_bytes()
    image = decode(content, turn=turn)
    exif = _upright_exif(image.exif)
    xmp = b"\n".join(read_embedded(io.BytesIO(content)).xmp)
    if suffix == ".png":
        texts = PngInfo()
        if xmp:
            texts.add_itxt("XML:com.adobe.xmp", xmp)
        image.rgb.save(target, format="PNG", compress_level=1, exif=exif, pnginfo=texts)
    else:
        image.rgb.save(
            target, format="JPEG", quality=_JPEG_QUALITY, subsampling=0, exif=exif, xmp=xmp[:_XMP_IN_JPEG]
        )


def _upright_exif(exif: Image.Exif) -> bytes:
    """EXIF without the orientation, since the pixels are upright; empty if it is damaged."""
    try:
        exif.pop(Base.Orientation, None)
        return exif.tobytes()
    except Exception:  # damaged EXIF cannot always be encoded again
        return b""
