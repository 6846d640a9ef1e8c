"""Volumes: where candidates are generated, and where nothing may fly.

Coordinates and lengths are those of one frame, on the wire the world's: metres when georeferenced.
"""

from typing import Annotated, Literal

from pydantic import Field

from fvs_schema.base import Input
from fvs_schema.quantities import MAX_COORDINATE

MOST_CORNERS = 200
"""Maximum number of corners of a polygon or path: each costs time for every position."""

Number = Annotated[float, Field(strict=True, ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Length = Annotated[float, Field(strict=True, gt=0.0, le=MAX_COORDINATE)]
Vector = tuple[Number, Number, Number]
UP: Vector = (0.0, 0.0, 1.0)


class BaseVolume(Input):
    """What all volumes have; ``up`` is the direction of their heights, of any length."""

    up: Vector = UP
    """The direction of heights, of any length."""


class Box(BaseVolume):
    """A box that stands upright: ``size`` along its first level side, its second, and up.

    ``along`` is the direction of the first side, made level.
    """

    kind: Literal["box"] = "box"
    """The volume's name."""
    centre: Vector
    """The middle of the box."""
    size: tuple[Length, Length, Length]
    """Its extent along the first level side, along the second, and up."""
    along: Vector | None = None
    """The direction of the first side, made level; by default x."""


class Cylinder(BaseVolume):
    """An upright cylinder of ``radius`` and ``height``, over its ``base``, the middle of the lower disc."""

    kind: Literal["cylinder"] = "cylinder"
    """The volume's name."""
    base: Vector
    """The middle of the lower disc."""
    radius: Length
    """The radius of the discs."""
    height: Length
    """The distance between them."""


class Prism(BaseVolume):
    """A polygon between two heights.

    ``corners`` in order around the polygon; only their level position counts. ``lower`` and ``upper`` are
    heights over the origin of the frame, along ``up``. An edge that two parts share belongs to either.
    """

    kind: Literal["prism"] = "prism"
    """The volume's name."""
    corners: Annotated[tuple[Vector, ...], Field(min_length=3, max_length=MOST_CORNERS, fail_fast=True)]
    """The corners in order around the polygon; only their level position counts."""
    lower: Number
    """The lower height, over the origin of the frame along `up`."""
    upper: Number
    """The upper height."""


class Shell(BaseVolume):
    """Around an object: between the distances ``inner`` and ``outer`` from its ``centre``.

    ``above``: only from this height over the centre, along ``up``; it may be negative.
    """

    kind: Literal["shell"] = "shell"
    """The volume's name."""
    centre: Vector
    """The middle of the object."""
    inner: Annotated[float, Field(strict=True, ge=0.0, le=MAX_COORDINATE)]
    """The least distance from it."""
    outer: Length
    """The greatest distance from it."""
    above: Number | None = None
    """Only from this height over the centre, along `up`; it may be negative. By default at all heights."""


class Corridor(BaseVolume):
    """Along a path: within ``radius`` of the line through its corners."""

    kind: Literal["corridor"] = "corridor"
    """The volume's name."""
    path: Annotated[tuple[Vector, ...], Field(min_length=2, max_length=MOST_CORNERS, fail_fast=True)]
    """The corners of its line, in order."""
    radius: Length
    """How far from the line it reaches."""


Volume = Annotated[Box | Cylinder | Prism | Shell | Corridor, Field(discriminator="kind")]
