"""Volumes: where candidates may be, and where nothing may fly.

They are values of any frame: lengths are in its unit, and each says which direction is up. ``moved`` takes a
volume to another frame, from the world to the model for example.
"""

from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import SimilarityTransform, level_axes
from fvs_engine.geometry.validation import MAX_COORDINATE
from fvs_engine.plan.segments import (
    boxes_meet,
    inside_ball,
    inside_slab,
    nearest_segment,
    polygon_contains,
    polygon_crossed,
    segments_distance,
)
from fvs_engine.records import Record, first_error

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_CORNERS = 200
"""Of a polygon or a path: every one costs time for every position."""
_LEAST_EXTENT = 1e-9
"""Smallest extent as a share of the coordinates: less is rounding."""
_CHUNK = 4_096
_MOST_DRAWS = 2_000
"""Positions drawn per position found before a volume counts as having no room."""
_MOST_DRAWN = 4_000_000

Number = Annotated[float, Field(strict=True, ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Length = Annotated[float, Field(strict=True, gt=0.0, le=MAX_COORDINATE)]
Vector = tuple[Number, Number, Number]
_UP: Vector = (0.0, 0.0, 1.0)


class _Volume(Record):
    """What all volumes can do; ``up`` is the direction of their heights, of any length."""

    up: Vector = _UP

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
        return _vector(other_from_this.rotation @ self.up)


class Box(_Volume):
    """A box that stands upright: ``size`` along its first level side, its second, and up.

    ``along`` is the direction of the first side, made level.
    """

    kind: Literal["box"] = "box"
    centre: Vector
    size: tuple[Length, Length, Length]
    along: Vector | None = None

    def contains(self, points: Array) -> Mask:
        """See ``_Volume``."""
        return np.asarray((np.abs(self._local(points)) <= 0.5 * np.array(self.size)).all(axis=1))

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``_Volume``."""
        first, last = np.zeros(len(starts)), np.ones(len(starts))
        a, b = self._local(starts), self._local(ends)
        for axis, side in enumerate(self.size):
            enter, leave = inside_slab(a[:, axis], b[:, axis], -0.5 * side, 0.5 * side)
            first, last = np.maximum(first, enter), np.minimum(last, leave)
        return np.asarray(first <= last)

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``_Volume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "centre": _point(other_from_this, self.centre),
                "size": tuple(other_from_this.scale * side for side in self.size),
                "along": _vector(other_from_this.rotation @ self._axes[:, 0]),
            }
        )

    def _check(self) -> None:
        _require_extent("box", min(self.size), self.centre)
        if self.along is not None:
            level = level_axes(self.up)[:, :2].T @ np.array(self.along)
            if np.linalg.norm(level) <= 1e-6 * np.linalg.norm(self.along):
                raise ValueError("The first side of a box cannot point up; `along` is a level direction.")

    def _at(self, units: Array) -> Array:
        local = (units - 0.5) * np.array(self.size)
        return np.asarray(self.centre + local @ self._axes.T)

    @property
    def _axes(self) -> Array:
        axes = level_axes(self.up)
        if self.along is None:
            return axes
        x = axes[:, :2] @ (axes[:, :2].T @ np.array(self.along))
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(axes[:, 2], x), axes[:, 2]])

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.centre)) @ self._axes)


class Cylinder(_Volume):
    """An upright cylinder of ``radius`` and ``height``, over its ``base``, the middle of the lower disc."""

    kind: Literal["cylinder"] = "cylinder"
    base: Vector
    radius: Length
    height: Length

    def contains(self, points: Array) -> Mask:
        """See ``_Volume``."""
        local = self._local(points)
        height = local[:, 2]
        within = np.hypot(local[:, 0], local[:, 1]) <= self.radius
        return np.asarray(within & (height >= 0.0) & (height <= self.height))

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``_Volume``."""
        a, b = self._local(starts), self._local(ends)
        first, last = inside_ball(a[:, :2], b[:, :2], self.radius)
        enter, leave = inside_slab(a[:, 2], b[:, 2], 0.0, self.height)
        return np.asarray(np.maximum(first, enter) <= np.minimum(last, leave))

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``_Volume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "base": _point(other_from_this, self.base),
                "radius": other_from_this.scale * self.radius,
                "height": other_from_this.scale * self.height,
            }
        )

    def _check(self) -> None:
        _require_extent("cylinder", min(self.radius, self.height), self.base)

    def _at(self, units: Array) -> Array:
        radii, angles = self.radius * np.sqrt(units[:, 0]), 2.0 * np.pi * units[:, 1]
        local = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), self.height * units[:, 2]])
        return np.asarray(self.base + local @ self._axes.T)

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.base)) @ self._axes)


class Prism(_Volume):
    """A polygon between two heights.

    ``corners`` in order around the polygon; only their level position counts. ``lower`` and ``upper`` are
    heights over the origin of the frame, along ``up``. An edge that two parts share belongs to either.
    """

    kind: Literal["prism"] = "prism"
    corners: Annotated[tuple[Vector, ...], Field(min_length=3, max_length=MOST_CORNERS, fail_fast=True)]
    lower: Number
    upper: Number

    def contains(self, points: Array) -> Mask:
        """See ``_Volume``."""
        local = points @ self._axes
        height = local[:, 2]
        mask = (height >= self.lower) & (height <= self.upper)
        mask[mask] = polygon_contains(self._polygon, local[mask, :2])
        return np.asarray(mask)

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``_Volume``."""
        a, b = starts @ self._axes, ends @ self._axes
        enter, leave = inside_slab(a[:, 2], b[:, 2], self.lower, self.upper)
        mask = np.asarray(enter <= leave)
        a, b = a[mask, :2], b[mask, :2]
        enter, leave = enter[mask, None], leave[mask, None]
        mask[mask] = polygon_crossed(self._polygon, a + enter * (b - a), a + leave * (b - a))
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``_Volume``."""
        up = self._turned(other_from_this)
        offset = float(other_from_this.translation @ np.array(up)) / float(np.linalg.norm(up))
        return self.model_validate(
            {
                "up": up,
                "corners": tuple(_point(other_from_this, corner) for corner in self.corners),
                "lower": other_from_this.scale * self.lower + offset,
                "upper": other_from_this.scale * self.upper + offset,
            }
        )

    def _check(self) -> None:
        if self.lower >= self.upper:
            raise ValueError(
                f"A prism needs a height: its lower end, {self.lower:g}, is not under its upper, "
                f"{self.upper:g}."
            )
        _require_extent("prism", self.upper - self.lower, (self.lower, self.upper, 0.0))
        polygon = self._polygon
        count = len(polygon)
        following = np.roll(polygon, -1, axis=0)
        if (np.linalg.norm(following - polygon, axis=1) <= _LEAST_EXTENT * np.abs(polygon).max()).any():
            raise ValueError("Two corners of the polygon that follow each other are the same; leave one out.")
        centred = polygon - polygon.mean(axis=0)
        after = np.roll(centred, -1, axis=0)
        area = 0.5 * abs(float((centred[:, 0] * after[:, 1] - centred[:, 1] * after[:, 0]).sum()))
        for number in range(count - 2):
            others = np.arange(number + 2, count - (number == 0))
            starts = np.broadcast_to(polygon[number], (len(others), 2))
            ends = np.broadcast_to(following[number], (len(others), 2))
            met = segments_distance(starts, ends, polygon[others], following[others]) == 0.0
            if met.any():
                raise ValueError(
                    f"The polygon crosses itself: its edges {number + 1} and {others[met][0] + 1} meet. "
                    "Give its corners in order around it."
                )
        if area <= _LEAST_EXTENT * np.ptp(polygon, axis=0).max() ** 2:
            raise ValueError("The corners of the polygon are on a line: it has no area.")

    def _at(self, units: Array) -> Array:
        low, high = self._polygon.min(axis=0), self._polygon.max(axis=0)
        lower, upper = np.array([*low, self.lower]), np.array([*high, self.upper])
        return np.asarray((lower + units * (upper - lower)) @ self._axes.T)

    @property
    def _polygon(self) -> Array:
        return np.asarray(np.array(self.corners) @ self._axes[:, :2])


class Shell(_Volume):
    """Around an object: between the distances ``inner`` and ``outer`` from its ``centre``.

    ``above``: only from this height over the centre, along ``up``; it may be negative.
    """

    kind: Literal["shell"] = "shell"
    centre: Vector
    inner: Annotated[float, Field(strict=True, ge=0.0, le=MAX_COORDINATE)]
    outer: Length
    above: Number | None = None

    def contains(self, points: Array) -> Mask:
        """See ``_Volume``."""
        local = self._local(points)
        distances = np.linalg.norm(local, axis=1)
        return np.asarray(
            (distances >= self.inner) & (distances <= self.outer) & (local[:, 2] >= self._lowest)
        )

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``_Volume``."""
        a, b = self._local(starts), self._local(ends)
        first, last = inside_ball(a, b, self.outer)
        enter, leave = inside_slab(a[:, 2], b[:, 2], self._lowest, self.outer)
        first, last = np.maximum(first, enter), np.minimum(last, leave)
        mask = np.asarray(first <= last)
        a, b, first, last = a[mask], b[mask], first[mask, None], last[mask, None]
        # The distance from the centre is largest at one of the ends of what is inside the outer ball.
        farthest = np.maximum(
            np.linalg.norm(a + first * (b - a), axis=1), np.linalg.norm(a + last * (b - a), axis=1)
        )
        mask[mask] = farthest >= self.inner
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``_Volume``."""
        scale = other_from_this.scale
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "centre": _point(other_from_this, self.centre),
                "inner": scale * self.inner,
                "outer": scale * self.outer,
                "above": None if self.above is None else scale * self.above,
            }
        )

    def _check(self) -> None:
        if self.inner >= self.outer:
            raise ValueError(
                f"A shell needs a thickness: its inner radius, {self.inner:g}, is not under its outer, "
                f"{self.outer:g}."
            )
        if self.above is not None and self.above >= self.outer:
            raise ValueError(f"Nothing of a shell of radius {self.outer:g} is above {self.above:g}.")
        _require_extent("shell", min(self.outer - self.inner, self.outer - self._lowest), self.centre)

    def _at(self, units: Array) -> Array:
        cubes = self.inner**3 + units[:, 0] * (self.outer**3 - self.inner**3)
        radii, angles = np.cbrt(cubes), 2.0 * np.pi * units[:, 1]
        z = 1.0 - units[:, 2] * (1.0 - max(-1.0, self._lowest / self.outer))
        ring = np.sqrt(1.0 - z**2)
        directions = np.column_stack([ring * np.cos(angles), ring * np.sin(angles), z])
        return np.asarray(self.centre + radii[:, None] * directions @ self._axes.T)

    @property
    def _lowest(self) -> float:
        return -self.outer if self.above is None else max(-self.outer, self.above)

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.centre)) @ self._axes)


class Corridor(_Volume):
    """Along a path: within ``radius`` of the line through its corners."""

    kind: Literal["corridor"] = "corridor"
    path: Annotated[tuple[Vector, ...], Field(min_length=2, max_length=MOST_CORNERS, fail_fast=True)]
    radius: Length

    def contains(self, points: Array) -> Mask:
        """See ``_Volume``."""
        _, distances = nearest_segment(points, *self._edges)
        return np.asarray(distances <= self.radius)

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``_Volume``."""
        mask = np.zeros(len(starts), dtype=np.bool_)
        for one, other in zip(*self._edges, strict=True):
            left = np.flatnonzero(~mask)
            lower, upper = np.minimum(one, other) - self.radius, np.maximum(one, other) + self.radius
            left = left[boxes_meet(starts[left], ends[left], lower, upper)]
            pair = np.broadcast_to(one, (len(left), 3)), np.broadcast_to(other, (len(left), 3))
            mask[left] = segments_distance(starts[left], ends[left], *pair) <= self.radius
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``_Volume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "path": tuple(_point(other_from_this, corner) for corner in self.path),
                "radius": other_from_this.scale * self.radius,
            }
        )

    def _check(self) -> None:
        for corner in self.path:
            _require_extent("corridor", self.radius, corner)

    def _at(self, units: Array) -> Array:
        """In a box around each edge: a point counts only in the box of the edge that is nearest to it."""
        starts, ends = self._edges
        lengths = np.linalg.norm(ends - starts, axis=1)
        sizes = lengths + 2.0 * self.radius
        limits = np.cumsum(sizes)
        along = units[:, 0] * limits[-1]
        number = np.minimum(np.searchsorted(limits, along, side="right"), len(sizes) - 1)
        along -= limits[number] - sizes[number] + self.radius
        # An edge without length has no direction: any serves for its ball.
        axes = np.stack(
            [level_axes(e - s if (e != s).any() else _UP) for s, e in zip(starts, ends, strict=True)]
        )
        local = np.column_stack([self.radius * (2.0 * units[:, 1:] - 1.0), along])
        points = starts[number] + np.einsum("nij,nj->ni", axes[number], local)
        nearest, _ = nearest_segment(points, starts, ends)
        return np.asarray(points[nearest == number])

    @property
    def _edges(self) -> tuple[Array, Array]:
        path = np.array(self.path)
        return path[:-1], path[1:]


Volume = Annotated[Box | Cylinder | Prism | Shell | Corridor, Field(discriminator="kind")]
AnyVolume = Box | Cylinder | Prism | Shell | Corridor

_VOLUME: TypeAdapter[AnyVolume] = TypeAdapter(Volume)


def volume_from_json(text: str | bytes) -> AnyVolume:
    """The volume of a JSON object with its ``kind``. Raises ``InvalidInputError`` saying what is wrong."""
    try:
        return _VOLUME.validate_json(text)
    except ValidationError as error:
        raise InvalidInputError(
            f"The volume cannot be used: {first_error(error, 'the volume')}",
            hint="A volume is a box, cylinder, prism, shell or corridor with a positive extent.",
        ) from error


_PLASTIC = 1.2207440846057596
"""The root of x⁴ = x + 1."""


def _units(first: int, count: int) -> Array:
    """Elements of the sequence R3 in the unit cube, [count, 3]."""
    steps = np.array([_PLASTIC**-1, _PLASTIC**-2, _PLASTIC**-3])
    numbers = np.arange(first + 1, first + count + 1)
    return np.asarray((0.5 + numbers[:, None] * steps) % 1.0)


def _require_extent(what: str, extent: float, around: Vector) -> None:
    if not extent > _LEAST_EXTENT * max(map(abs, around)):
        raise ValueError(f"The {what} has no extent that counts beside its coordinates: {extent:g}.")


def _point(other_from_this: SimilarityTransform, point: Vector) -> Vector:
    return _vector(other_from_this.apply(np.array(point)))


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
