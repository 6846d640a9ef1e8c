"""Where surveyed points are in the world frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.crs import NamedCrs
from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, middle_position
from fvs_schema.control_points import ControlPoints
from fvs_schema.scenes import AltitudeDatum, Origin

Array = NDArray[np.float64]

_FARTHEST_M = 50_000.0
"""Distance of control points from a scene's other positions that no scene has, but a wrong UTM zone."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Positions on Earth by the names of the points; those without ``heights`` have that of the middle."""

    positions: Mapping[str, GeodeticPosition]
    heights: frozenset[str]
    datum: AltitudeDatum

    @staticmethod
    def of(control: ControlPoints) -> "Survey":
        """The positions of the points; raises ``InvalidInputError``, naming the coordinates or the CRS."""
        crs = NamedCrs(control.crs)
        known = [point.z for point in control.points if point.z is not None]
        usual = float(np.median(known)) if known else 0.0
        coordinates = [(point.x, point.y, usual if point.z is None else point.z) for point in control.points]
        positions = crs.geodetic(np.array(coordinates).reshape(-1, 3))
        return Survey(
            positions=dict(zip((point.name for point in control.points), positions, strict=True)),
            heights=frozenset(point.name for point in control.points if point.z is not None),
            datum=control.altitude_datum or crs.altitude_datum or AltitudeDatum.SEA_LEVEL,
        )

    @property
    def _middle(self) -> GeodeticPosition:
        return middle_position(list(self.positions.values()))

    def require_near(self, place: GeodeticPosition) -> None:
        """Raise ``InvalidInputError`` when other positions have the scene at a ``place`` far away."""
        away_m = float(np.linalg.norm(enu_from_geodetic(self._middle, place)))
        if away_m > _FARTHEST_M:
            raise InvalidInputError(
                f"The control points are {away_m / 1000:,.0f} km from where GPS or the origin has the scene.",
                hint="Check the CRS and its zone. If GPS is wrong, reconstruct with --no-gps, or create a "
                "scene with an origin near the points.",
            )

    @property
    def origin(self) -> Origin:
        """The middle of the points."""
        middle = self._middle
        return Origin(
            latitude_deg=middle.latitude_deg,
            longitude_deg=middle.longitude_deg,
            altitude_m=middle.altitude_m,
            altitude_datum=self.datum,
        )

    def in_world(self, origin: Origin) -> Mapping[str, Array]:
        """East, north and up [3] of the points from an ``origin`` of the same datum; up may be NaN."""
        place = position_of(origin)
        found = {name: enu_from_geodetic(position, place) for name, position in self.positions.items()}
        for name in found.keys() - self.heights:
            found[name][2] = np.nan
        return found


def position_of(origin: Origin) -> GeodeticPosition:
    """The position of an origin, above its datum."""
    return GeodeticPosition(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
