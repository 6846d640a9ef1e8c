"""Volumes: where candidates are generated, and where nothing may fly.

Coordinates and lengths are those of the scene's world: metres when georeferenced. `up` is the direction of
heights.
"""

from typing import Annotated, Literal

from pydantic import Field

from fvs_client.models.base import Input, Vector

_UP = (0.0, 0.0, 1.0)


class Box(Input):
    """A box that stands upright: `size` along its first level side, its second, and up.

    `along` is the direction of the first side, made level.
    """

    kind: Literal["box"] = "box"
    centre: Vector
    size: Vector
    along: Vector | None = None
    up: Vector = _UP


class Cylinder(Input):
    """An upright cylinder over its `base`, the middle of the lower disc."""

    kind: Literal["cylinder"] = "cylinder"
    base: Vector
    radius: float
    height: float
    up: Vector = _UP


class Prism(Input):
    """A polygon between two heights over the origin.

    `corners` in order around the polygon, 3 to 200; only their level position counts.
    """

    kind: Literal["prism"] = "prism"
    corners: tuple[Vector, ...]
    lower: float
    upper: float
    up: Vector = _UP


class Shell(Input):
    """Around an object: between the distances `inner` and `outer` from its `centre`.

    `above`: only from this height over the centre; it may be negative.
    """

    kind: Literal["shell"] = "shell"
    centre: Vector
    inner: float
    outer: float
    above: float | None = None
    up: Vector = _UP


class Corridor(Input):
    """Along a path of 2 to 200 corners: within `radius` of the line through them."""

    kind: Literal["corridor"] = "corridor"
    path: tuple[Vector, ...]
    radius: float
    up: Vector = _UP


Volume = Annotated[Box | Cylinder | Prism | Shell | Corridor, Field(discriminator="kind")]
