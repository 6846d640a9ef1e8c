"""The header of a JPEG file: its segments up to the first scan (ITU-T T.81, annex B).

Previews, gain maps and the further images of an MPO lie inside segments or behind the photograph: a search
for a marker finds theirs, too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, NamedTuple

START = b"\xff\xd8"
APP1 = 0xE1
_START_OF_SCAN, _END = 0xDA, 0xD9
_WITHOUT_LENGTH = frozenset({0x01, 0xD8, *range(0xD0, 0xD8)})
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_PROGRESSIVE = frozenset({0xC2, 0xC6, 0xCA, 0xCE})


class Segment(NamedTuple):
    """One segment; ``content`` is what follows its length."""

    marker: int
    content: bytes


@dataclass(frozen=True)
class Frame:
    """What the frame header declares; ``progressive``: in several scans, each with a part of every pixel."""

    bits: int
    channels: int
    progressive: bool


def segments(file: BinaryIO) -> Iterator[Segment]:
    """The segments in their order; the last one is the header of the first scan.

    They end early where the file is damaged, and there are none in a file of another format.
    """
    file.seek(0)
    if file.read(2) != START:
        return
    while True:
        marker = file.read(2)
        while marker == b"\xff\xff":  # the first is a fill byte
            marker = b"\xff" + file.read(1)
        if len(marker) < 2 or marker[0] != 0xFF or marker[1] in (0x00, _END):
            return
        if marker[1] in _WITHOUT_LENGTH:
            continue
        length = int.from_bytes(file.read(2)) - 2
        if length < 0 or len(content := file.read(length)) < length:
            return
        yield Segment(marker[1], content)
        if marker[1] == _START_OF_SCAN:
            return


def read_frame(file: BinaryIO) -> Frame | None:
    """What the frame header declares; None without one."""
    return next((_frame(one) for one in segments(file) if _is_frame(one)), None)


def keeps_coefficients(file: BinaryIO) -> bool:
    """Whether decoders keep the coefficients of the whole image: those of several scans make one pixel.

    So it is in progressive files, and where channels have scans of their own. True if the header is damaged.
    """
    frame = None
    for segment in segments(file):
        if _is_frame(segment):
            frame = _frame(segment)
        elif segment.marker == _START_OF_SCAN and segment.content and frame is not None:
            return frame.progressive or segment.content[0] < frame.channels
    return True


def _is_frame(segment: Segment) -> bool:
    return segment.marker in _FRAMES and len(segment.content) >= 6


def _frame(segment: Segment) -> Frame:
    return Frame(segment.content[0], segment.content[5], segment.marker in _PROGRESSIVE)
