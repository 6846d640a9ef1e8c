"""Where surveyed points are in the world frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry.crs import NamedCrs
from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, middle_position
from fvs_schema.control_points import ControlPoints
from fvs_schema.scenes import AltitudeDatum, Origin

Array = NDArray[np.float64]


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
    def origin(self) -> Origin:
        """The middle of the points."""
        middle = middle_position(list(self.positions.values()))
        return Origin(
            latitude_deg=middle.latitude_deg,
            longitude_deg=middle.longitude_deg,
            altitude_m=middle.altitude_m,
            altitude_datum=self.datum,
        )

    def in_world(self, origin: Origin) -> Mapping[str, Array]:
        """East, north and up [3] of the points from an ``origin`` of the same datum; up may be NaN."""
        place = GeodeticPosition(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
        found = {name: enu_from_geodetic(position, place) for name, position in self.positions.items()}
        for name in found.keys() - self.heights:
            found[name][2] = np.nan
        return found
