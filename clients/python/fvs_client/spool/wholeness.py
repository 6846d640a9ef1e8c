"""Whether a camera has written a file completely, by its format's end marker."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO

_BEGIN_BYTES = 16
"""Minimum size of an image."""
_BLOCK_BYTES = 1 << 16
_JPEG_BEGIN, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
# In entropy-coded data 0xFF is followed by 0x00, by a restart marker or by fill bytes; else a marker begins.
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_PNG_BEGIN, _PNG_END = b"\x89PNG\r\n\x1a\n", b"\x00\x00\x00\x00IEND\xaeB`\x82"


def is_whole(path: Path) -> bool:
    """Whether the file has its end; of a format without one, whether it has begun. Raises ``OSError``."""
    with path.open("rb") as file:
        begin = file.read(_BEGIN_BYTES)
        ends = next((check for known, check in _CHECKS.items() if begin.startswith(known)), None)
        return len(begin) == _BEGIN_BYTES and any(begin) and (ends is None or ends(file, begin))


def _jpeg_ends(file: BinaryIO, _begin: bytes) -> bool:
    """Follow the segments to the end marker (ITU-T T.81, annex B).

    The file's last bytes do not tell: a thumbnail has an end of its own, and cameras write zeros or trailers
    after the photograph's.
    """
    at = len(_JPEG_BEGIN)
    while True:
        file.seek(at)
        while (found := _MARKER.search(block := file.read(_BLOCK_BYTES))) is None:
            if len(block) < 2:
                return False
            at += len(block) - 1  # a marker may lie across two blocks
            file.seek(at)
        at += found.start() + 2
        if found.group() == _JPEG_END:
            return True
        file.seek(at)
        length = file.read(2)
        if len(length) < 2:
            return False
        at += max(2, int.from_bytes(length))


def _png_ends(file: BinaryIO, _begin: bytes) -> bool:
    size = file.seek(0, 2)
    file.seek(max(0, size - _BLOCK_BYTES))
    return _PNG_END in file.read()


def _riff_ends(file: BinaryIO, begin: bytes) -> bool:
    return file.seek(0, 2) >= 8 + int.from_bytes(begin[4:8], "little")


_CHECKS: Mapping[bytes, Callable[[BinaryIO, bytes], bool]] = {
    _JPEG_BEGIN: _jpeg_ends,
    _PNG_BEGIN: _png_ends,
    b"RIFF": _riff_ends,
}
