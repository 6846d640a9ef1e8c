"""What all volumes can do."""

from abc import abstractmethod
from collections.abc import Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from fvs_engine.geometry import SimilarityTransform, level_axes
from fvs_schema import volumes
from fvs_schema.volumes import Vector

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_EXTENT = 1e-9
"""Smallest extent as a share of the coordinates: less is rounding."""
_CHUNK = 4_096
_MOST_DRAWS = 2_000
"""Positions drawn per position found before a volume counts as having no room."""
_MOST_DRAWN = 4_000_000
_PLASTIC = 1.2207440846057596
"""The root of x⁴ = x + 1."""


class BaseVolume(volumes.BaseVolume):
    """What all volumes can do; ``up`` is the direction of their heights, of any length."""

    @model_validator(mode="after")
    def _is_usable(self) -> Self:
        if not any(self.up):
            raise ValueError("The up vector is zero.")
        self._check()
        return self

    @abstractmethod
    def contains(self, points: Array) -> Mask:
        """Which of ``points`` [N, 3] are inside or on the surface."""

    @abstractmethod
    def crossed(self, starts: Array, ends: Array) -> Mask:
        """Which of the segments from ``starts`` [N, 3] to ``ends`` [N, 3] have a point in the volume."""

    @abstractmethod
    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """The same volume in another frame."""

    @abstractmethod
    def _check(self) -> None:
        """Raise ``ValueError`` where the numbers make no volume."""

    @abstractmethod
    def _at(self, units: Array) -> Array:
        """Positions [·, 3] for points [N, 3] in the unit cube, equal shares of it for equal volumes.

        Some may be outside of the volume; parts of the cube may stand for none.
        """

    def sample(self, count: int) -> Array:
        """The first ``count`` positions of ``stream``; fewer where the volume is too thin to find them."""
        found: list[Array] = []
        missing = count
        for positions in self.stream():
            found.append(positions[:missing])
            missing -= len(found[-1])
            if missing <= 0:
                break
        return np.concatenate(found) if found else np.zeros((0, 3))

    def stream(self) -> Iterator[Array]:
        """Positions spread evenly over the volume, in portions [·, 3] that may be empty; always the same.

        They follow the additive recurrence R3 (Roberts, "The unreasonable effectiveness of quasirandom
        sequences", 2018): every beginning of it is even by itself, so that asking for more positions keeps
        those before. A lattice would need its spacing known in advance and leave gaps at curved surfaces.
        Ends where fewer than one draw in ``_MOST_DRAWS`` is inside, and after ``_MOST_DRAWN``.
        """
        drawn = found = 0
        while drawn <= min(_MOST_DRAWN, _MOST_DRAWS * (found + 1)):
            positions = self._at(_units(drawn, _CHUNK))
            positions = positions[self.contains(positions)]
            drawn, found = drawn + _CHUNK, found + len(positions)
            yield positions

    @property
    def _axes(self) -> Array:
        """The columns are two level directions and up."""
        return level_axes(self.up)

    def _turned(self, other_from_this: SimilarityTransform) -> Vector:
        return as_vector(other_from_this.rotation @ self.up)


def require_extent(what: str, extent: float, around: Vector) -> None:
    """Raise ``ValueError`` where ``extent`` is lost in the rounding of the coordinates ``around`` it."""
    if not extent > LEAST_EXTENT * max(map(abs, around)):
        raise ValueError(f"The {what} has no extent that counts beside its coordinates: {extent:g}.")


def moved_point(other_from_this: SimilarityTransform, point: Vector) -> Vector:
    """The coordinates of a point in another frame."""
    return as_vector(other_from_this.apply(np.array(point)))


def as_vector(values: Array) -> Vector:
    """Three numbers of an array [3]."""
    x, y, z = values.tolist()
    return x, y, z


def _units(first: int, count: int) -> Array:
    """Elements of the sequence R3 in the unit cube, [count, 3]."""
    steps = np.array([_PLASTIC**-1, _PLASTIC**-2, _PLASTIC**-3])
    numbers = np.arange(first + 1, first + count + 1)
    return np.asarray((0.5 + numbers[:, None] * steps) % 1.0)
