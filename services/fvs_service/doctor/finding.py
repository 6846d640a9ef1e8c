"""A finding of the doctor."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """Something that should not be there, or is missing; ``repair`` ends that, and may be called twice."""

    kind: str
    what: str
    """The blob, row, file or folder."""
    remedy: str
    """The effect of ``repair``."""
    repair: Callable[[], object]
