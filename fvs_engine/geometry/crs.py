"""Coordinate reference systems by name: their area, and geodetic positions from coordinates in them."""

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_schema.scenes import AltitudeDatum

Array = NDArray[np.float64]

_WGS_84_3D = 4979
_MARGIN_DEG = 3.0
"""How far outside a CRS's area of use a scene may be: half a UTM zone, since flights cross their edges."""
_UTM = re.compile(r"WGS\s*84\s+UTM\s+(?:zone\s+)?([1-9]|[1-5]\d|60)\s*([NS])", re.IGNORECASE)
_ORDER = "Check the CRS, and the order of the coordinates: x is east or the longitude, z the height."
_ALTITUDES_M = (-12_000.0, 100_000.0)
_NAMES = "Write EPSG and the code, such as EPSG:25832, or WGS84 UTM 32N, or a PROJ string."


def outside_area(crs: CRS, position: GeodeticPosition) -> str | None:
    """The name of the area that a CRS is for, when a position is far outside it."""
    area = crs.area_of_use
    if area is None:
        return None
    # Areas across the antimeridian have their west east of their east.
    width = (area.east - area.west) % 360.0 or 360.0
    inside = (position.longitude_deg - area.west + _MARGIN_DEG) % 360.0 <= width + 2.0 * _MARGIN_DEG
    lower, upper = area.south - _MARGIN_DEG, area.north + _MARGIN_DEG
    return None if inside and lower <= position.latitude_deg <= upper else str(area.name.rstrip("."))


@dataclass(frozen=True)
class NamedCrs:
    """The CRS that ``name`` stands for: an EPSG code, ``WGS84 UTM 32N`` or a PROJ string.

    Raises ``InvalidInputError`` when there is none.
    """

    name: str

    def __post_init__(self) -> None:
        try:
            crs = self._crs
        except CRSError as error:
            code = re.fullmatch(r"EPSG:\d+", self.name.strip(), re.IGNORECASE)
            what = (
                f"There is no CRS with the code {self.name.strip()}." if code else f"{self.name!r} is no CRS."
            )
            raise InvalidInputError(what, hint=_NAMES) from error
        if not (crs.is_projected or crs.is_geographic or crs.is_geocentric):
            raise InvalidInputError(
                f"{self.name} ({crs.name}) does not say where on Earth its coordinates are.", hint=_NAMES
            )
        try:
            _ = self._to_wgs84
        except ProjError as error:  # a file of shifts (nadgrids) that is not there
            raise InvalidInputError(
                f"Coordinates in {self.name!r} cannot be converted to WGS 84 here.",
                hint="Leave out a file that its definition names, or convert the coordinates first.",
            ) from error

    @cached_property
    def _crs(self) -> CRS:
        text = self.name.strip()
        utm = _UTM.fullmatch(text)
        if utm is not None:
            return CRS.from_epsg((32_600 if utm[2].upper() == "N" else 32_700) + int(utm[1]))
        return CRS.from_user_input(text)

    @property
    def altitude_datum(self) -> AltitudeDatum | None:
        """What its heights are measured from; None for a CRS without heights."""
        if self._crs.is_compound:
            return AltitudeDatum.SEA_LEVEL
        return AltitudeDatum.ELLIPSOID if len(self._crs.axis_info) == 3 else None

    def geodetic(self, coordinates: Array) -> list[GeodeticPosition]:
        """The positions of ``coordinates`` [N, 3]: easting or longitude, northing or latitude, height.

        Heights are in metres, or in the unit of the CRS's own. Those above a geoid are kept as they are.
        Raises ``InvalidInputError``, naming the coordinates, for what is not on Earth or far outside the area
        of the CRS.
        """
        x, y, z = np.asarray(coordinates, dtype=np.float64).T
        if self.altitude_datum is AltitudeDatum.ELLIPSOID:
            longitudes, latitudes, altitudes = self._to_wgs84.transform(x, y, z)
        else:
            longitudes, latitudes = self._to_wgs84.transform(x, y)
            altitudes = z * self._height_unit_m
        # At the antimeridian longitudes may go on beyond 180; what is not on Earth is infinite.
        known = np.abs(longitudes) <= 360.0
        longitudes = np.where(known, (np.where(known, longitudes, 0.0) + 180.0) % 360.0 - 180.0, longitudes)
        found = []
        for given, *numbers in zip(coordinates.tolist(), latitudes, longitudes, altitudes, strict=True):
            written = ", ".join(f"{number:.10g}" for number in given)
            try:
                position = GeodeticPosition(*map(float, numbers))
            except InvalidInputError as error:
                raise InvalidInputError(
                    f"{written} is not a position on Earth in {self.name}.", hint=_ORDER
                ) from error
            area = outside_area(self._with_area, position)
            if area is not None:
                raise InvalidInputError(f"{written} is not in the area of {self.name}: {area}.", hint=_ORDER)
            if not _ALTITUDES_M[0] <= position.altitude_m <= _ALTITUDES_M[1]:
                raise InvalidInputError(
                    f"The height of {written} is {position.altitude_m:.6g} m.", hint=_ORDER
                )
            found.append(position)
        return found

    @cached_property
    def _horizontal(self) -> CRS:
        return self._crs.sub_crs_list[0] if self._crs.is_compound else self._crs

    @cached_property
    def _to_wgs84(self) -> Transformer:
        return Transformer.from_crs(self._horizontal, _WGS_84_3D, always_xy=True)

    @property
    def _height_unit_m(self) -> float:
        if not self._crs.is_compound:
            return 1.0
        return float(self._crs.sub_crs_list[1].axis_info[0].unit_conversion_factor)

    @property
    def _with_area(self) -> CRS:
        """The CRS, or for a PROJ string of UTM, which has no area, that of the zone."""
        zone = self._horizontal.utm_zone
        if self._horizontal.area_of_use is not None or zone is None:
            return self._horizontal
        return CRS.from_epsg((32_600 if zone[-1] == "N" else 32_700) + int(zone[:-1]))
