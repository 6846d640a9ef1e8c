"""Projected coordinate reference systems by their EPSG codes, and the height of the geoid."""

import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Proj, Transformer
from pyproj.exceptions import CRSError, ProjError

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.crs import outside_area
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_schema.scenes import AltitudeDatum

Array = NDArray[np.float64]

_WGS_84 = 4326
_MSL_HEIGHT = 5714
_UTM_LATITUDES_DEG = (-80.0, 84.0)
_UPS_SOUTH, _UPS_NORTH = 5042, 5041
_ELLIPSOID_WKT = (
    'VERT_CS["Ellipsoid (metre)",VERT_DATUM["Ellipsoid",2002],UNIT["metre",1,AUTHORITY["EPSG","9001"]],'
    'AXIS["Ellipsoidal height",UP]]'
)
"""How WKT 1 has ellipsoidal heights; 2002 is its type of vertical datum for them."""

_PROJECTED = "Give the code of a projected CRS in metres, such as 32632 (UTM zone 32N), or none."
_GEOID = (
    "Give the geoid's height above the ellipsoid in metres, or a grid of it as GTX or GeoTIFF, such as "
    "PROJ's us_nga_egm96_15.tif."
)


@dataclass(frozen=True)
class ProjectedCrs:
    """The projected CRS ``epsg``; eastings and northings are in metres.

    Raises ``InvalidInputError`` for a code that does not exist or is of another kind.
    """

    epsg: int

    def __post_init__(self) -> None:
        try:
            crs = CRS.from_epsg(self.epsg)
        except CRSError as error:
            raise InvalidInputError(
                f"There is no CRS with the code EPSG:{self.epsg}.", hint=_PROJECTED
            ) from error
        if crs.is_compound and crs.sub_crs_list[0].to_epsg():
            raise InvalidInputError(
                f"EPSG:{self.epsg} ({crs.name}) has heights of its own.",
                hint=f"Give its horizontal part, {crs.sub_crs_list[0].to_epsg()}.",
            )
        if not crs.is_projected or any(axis.unit_name != "metre" for axis in crs.axis_info):
            raise InvalidInputError(
                f"EPSG:{self.epsg} ({crs.name}) is not a projected CRS in metres.", hint=_PROJECTED
            )

    @staticmethod
    def at(position: GeodeticPosition) -> "ProjectedCrs":
        """WGS 84 / UTM in the zone of a position; beyond UTM's latitudes, universal polar stereographic."""
        if position.latitude_deg < _UTM_LATITUDES_DEG[0]:
            return ProjectedCrs(_UPS_SOUTH)
        if position.latitude_deg > _UTM_LATITUDES_DEG[1]:
            return ProjectedCrs(_UPS_NORTH)
        zone = int((position.longitude_deg + 180.0) // 6.0) % 60 + 1
        return ProjectedCrs((32_600 if position.latitude_deg >= 0.0 else 32_700) + zone)

    @cached_property
    def _crs(self) -> CRS:
        return CRS.from_epsg(self.epsg)

    @cached_property
    def _from_wgs84(self) -> Transformer:
        return Transformer.from_crs(_WGS_84, self._crs, always_xy=True)

    @property
    def name(self) -> str:
        """Its name in the EPSG's registry."""
        return str(self._crs.name)

    def require_covers(self, position: GeodeticPosition) -> None:
        """Raise ``InvalidInputError`` when a position is far outside the area of use."""
        area = outside_area(self._crs, position)
        if area is None:
            return
        raise InvalidInputError(
            f"EPSG:{self.epsg} ({self.name}) is not for {position.latitude_deg:.4f}, "
            f"{position.longitude_deg:.4f}: its area is {area}.",
            hint=f"Give the code of a CRS for that place, or none: that is EPSG:{self.at(position).epsg}.",
        )

    def coordinates(self, geodetic: Array) -> Array:
        """Eastings, northings and the same altitudes [N, 3] of latitudes, longitudes, altitudes [N, 3]."""
        easting, northing = self._from_wgs84.transform(geodetic[:, 1], geodetic[:, 0])
        return np.stack([easting, northing, geodetic[:, 2]], axis=1)

    def convergence_and_scale(self, position: GeodeticPosition) -> tuple[float, float]:
        """The meridian convergence in degrees and the scale factor at a position."""
        factors = Proj(self._crs).get_factors(position.longitude_deg, position.latitude_deg)
        return float(factors.meridian_convergence), float(np.sqrt(factors.areal_scale))

    def accuracy_m(self, position: GeodeticPosition) -> float | None:
        """The accuracy of the transformation from WGS 84 there; None where it is not known."""
        self._from_wgs84.transform(position.longitude_deg, position.latitude_deg)
        accuracy = self._from_wgs84.get_last_used_operation().accuracy
        return float(accuracy) if accuracy >= 0.0 else None

    def wkt(self, datum: AltitudeDatum) -> str:
        """The CRS as WKT 1, which LAS requires, with its heights unless they are above takeoff."""
        horizontal = str(self._crs.to_wkt("WKT1_GDAL"))
        if datum is AltitudeDatum.TAKEOFF:
            return horizontal
        if datum is AltitudeDatum.ELLIPSOID:
            vertical, name = _ELLIPSOID_WKT, "Ellipsoid (metre)"
        else:
            msl = CRS.from_epsg(_MSL_HEIGHT)
            vertical, name = msl.to_wkt("WKT1_GDAL"), msl.name
        return f'COMPD_CS["{self.name} + {name}",{horizontal},{vertical}]'


def geoid_height_m(geoid: Path | float, position: GeodeticPosition) -> float:
    """The height of the geoid above the ellipsoid at a position: the number, or interpolated in the grid.

    Raises ``InvalidInputError`` for a file that is missing, no grid of heights, or does not cover the place.
    """
    if isinstance(geoid, float):
        return geoid
    if not geoid.is_file():
        raise InvalidInputError(f"{geoid}: there is no such file.", hint=_GEOID, path=geoid)
    with tempfile.TemporaryDirectory() as folder:  # PROJ takes a comma or quote in a path for its own
        grid = Path(folder, f"grid{geoid.suffix}")
        grid.symlink_to(geoid.absolute())
        steps = (
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f'+step +proj=vgridshift +grids="{grid}" +multiplier=1'
        )
        try:
            shift = Transformer.from_pipeline(steps)
        except ProjError as error:
            raise InvalidInputError(
                f"{geoid} is not a grid of geoid heights.", hint=_GEOID, path=geoid
            ) from error
        height = float(shift.transform(position.longitude_deg, position.latitude_deg, 0.0)[2])
    if not np.isfinite(height):
        raise InvalidInputError(
            f"{geoid} does not cover {position.latitude_deg:.4f}, {position.longitude_deg:.4f}.",
            hint=_GEOID,
            path=geoid,
        )
    return height
