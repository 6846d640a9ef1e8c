"""The choice of frames: the sharpest of each moment, at even spacing."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from fvs_engine.images.sharpness import SHARP

FrameT = TypeVar("FrameT")

_HALF_WINDOW = 0.25
"""Share of the spacing before and after a moment from which its frame comes."""
_MEASURED = 24
"""Frames that are measured per spacing, at most: blur lasts longer than one frame of a fast video."""


@dataclass(frozen=True, eq=False)
class SharpFrame(Generic[FrameT]):
    """A chosen frame; ``sharpness`` is that of ``images.sharpness``."""

    time_s: float
    sharpness: float
    frame: FrameT


def choose_sharp_frames(
    frames: Iterable[tuple[float, FrameT]], every_s: float, measure: Callable[[FrameT], float]
) -> Iterator[SharpFrame[FrameT]]:
    """Choose the sharpest frame around each multiple of ``every_s``, from frames in the order of time.

    It is at most a quarter of the spacing away; where all of those are blurred, the first sharp one until the
    next moment is chosen, else the least blurred one. Holds one frame at a time, besides the one it is given.
    """
    best: SharpFrame[FrameT] | None = None
    moment, next_s = 0, -math.inf
    for time_s, frame in frames:
        now = math.floor(time_s / every_s + _HALF_WINDOW)
        if now > moment:
            if best is not None:
                yield best
            best, moment, next_s = None, now, -math.inf
        late = time_s > (moment + _HALF_WINDOW) * every_s
        if time_s < next_s or (late and best is not None and best.sharpness >= SHARP):
            continue
        next_s = time_s + every_s / _MEASURED
        sharpness = measure(frame)
        if best is None or sharpness > best.sharpness:
            best = SharpFrame(time_s, sharpness, frame)
    if best is not None:
        yield best
