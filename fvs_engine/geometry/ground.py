"""Which positions are under the ground of a terrain."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_coordinates
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import Terrain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundCheck:
    """The names of positions ``under`` the ground, and of those where it has no height (``unknown``).

    ``compared``: the number of all.
    """

    under: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    compared: int = 0

    @classmethod
    def of(
        cls, positions_m: Mapping[str, Array], origin: GeodeticPosition, terrain: Terrain
    ) -> "GroundCheck":
        """Compare positions [3] (east, north, up of ``origin``), by name, with a ``terrain`` of its datum.

        Raises ``InvalidInputError`` where the terrain has a height at none of them.
        """
        if not positions_m:
            return cls()
        under, unknown = [], []
        geodetic = geodetic_coordinates(np.stack(list(positions_m.values())), origin)
        for name, (latitude_deg, longitude_deg, altitude_m) in zip(
            positions_m, geodetic.tolist(), strict=True
        ):
            ground_m = terrain.height_m((latitude_deg, longitude_deg))
            if ground_m is None:
                unknown.append(name)
            elif altitude_m < ground_m:
                under.append(name)
        if len(unknown) == len(positions_m):
            latitude_deg, longitude_deg, _ = np.median(geodetic, axis=0).tolist()
            raise InvalidInputError(
                f"The terrain has no height at any of the {len(unknown)} candidates, around "
                f"{latitude_deg:.6f}, {longitude_deg:.6f}.",
                hint="Give a terrain that covers the scene, without holes there.",
            )
        return cls(tuple(under), tuple(unknown), len(positions_m))


def require_datum(terrain: Terrain, datum: AltitudeDatum) -> None:
    """Raise ``InvalidInputError`` for a terrain above another ``datum`` than a scene's altitudes."""
    if terrain.altitude_datum is not datum:
        raise InvalidInputError(
            f"Heights of the terrain are above {terrain.altitude_datum.in_words}, "
            f"the scene's altitudes above {datum.in_words}.",
            hint="Add the difference to its heights, and give the scene's datum as its altitude_datum.",
        )
