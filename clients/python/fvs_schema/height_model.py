"""Height models: files with heights of the ground, such as GeoTIFFs. Needs rasterio."""

import math
from collections.abc import Iterable
from os import PathLike, fspath
from types import TracebackType
from typing import Any, Self

from fvs_schema.fence import Place
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.terrain import MOST_HEIGHTS, MOST_IN_A_ROW, NO_HEIGHT_M, Terrain

_MARGIN = 3
"""Steps beyond the outermost places."""
_FINEST_DEG = 1e-7
_GROUND_M = -1_000.0, 10_000.0
"""Nobody flies over lower or higher ground: the deepest mines are half as deep."""
_MAP = "EPSG:4326"
_DEGREE_M = 111_195.0
_UNITS_M = {
    "": 1.0,
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "meters": 1.0,
    "foot": 0.3048,
    "feet": 0.3048,
    "ft": 0.3048,
}
_US_FOOT_M = 1200.0 / 3937.0
_HINT = "Give a raster of one band with its CRS, such as a GeoTIFF: `gdalinfo FILE` shows what a file has."


class HeightModelError(ValueError):
    """A file is no height model, or has no heights where they are needed; ``hint`` says what to do."""

    def __init__(self, message: str, *, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class HeightModel:
    """A height model in a file that GDAL reads, in any CRS; to be closed, or used in a ``with``.

    Its heights are above sea level, or above the ellipsoid where its CRS is geographic in three dimensions.
    Raises ``HeightModelError`` for a file that is none, and without rasterio.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self._rasterio, self._name = _rasterio(), fspath(path)
        try:
            self._file = self._rasterio.open(self._name)
        except (OSError, self._rasterio.errors.RasterioError) as error:
            raise HeightModelError(f"{self._name} is no height model: {error}.", hint=_HINT) from error
        try:
            self._metres, self._datum = self._unit(), self._heights_above()
        except HeightModelError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def around(self, places: Iterable[Place], margin_m: float = 0.0) -> Terrain:
        """The heights at places and ``margin_m`` around them, as fine as the file or a terrain can have them.

        Raises ``HeightModelError`` where the file has no height anywhere around them.
        """
        listed = list(places)
        south_deg, north_deg = min(place[0] for place in listed), max(place[0] for place in listed)
        east = [(place[1] - listed[0][1] + 180.0) % 360.0 - 180.0 for place in listed]
        west_deg, east_deg = listed[0][1] + min(east), listed[0][1] + max(east)
        margin_deg = margin_m / _DEGREE_M
        around_deg = margin_deg / max(math.cos(math.radians(south_deg)), _FINEST_DEG)
        south_deg, north_deg = south_deg - margin_deg, north_deg + margin_deg
        west_deg, east_deg = west_deg - around_deg, east_deg + around_deg
        middle = (south_deg + north_deg) / 2.0, (west_deg + east_deg) / 2.0
        steps = self._steps_deg(middle)
        rows, columns = _counts((north_deg - south_deg, east_deg - west_deg), steps)
        coarser = 1.0
        while rows * columns > MOST_HEIGHTS or max(rows, columns) > MOST_IN_A_ROW:
            coarser *= 1.05
            steps = steps[0] * 1.05, steps[1] * 1.05
            rows, columns = _counts((north_deg - south_deg, east_deg - west_deg), steps)
        south_deg, west_deg = (
            middle[0] - steps[0] * (rows - 1) / 2.0,
            middle[1] - steps[1] * (columns - 1) / 2.0,
        )
        heights = self._read((south_deg, west_deg), steps, (rows, columns), coarse=coarser > 2.0)
        if all(height == NO_HEIGHT_M for height in heights):
            raise HeightModelError(
                f"{self._name} has no height around {middle[0]:.6f}, {middle[1]:.6f}.",
                hint="Give a height model that covers the place: `gdalinfo FILE` shows its corners.",
            )
        return Terrain(
            south_deg=south_deg,
            west_deg=(west_deg + 180.0) % 360.0 - 180.0,
            latitude_step_deg=steps[0],
            longitude_step_deg=steps[1],
            columns=columns,
            heights_m=tuple(heights),
            altitude_datum=self._datum,
        )

    def _read(
        self, corner: Place, steps: tuple[float, float], counts: tuple[int, int], *, coarse: bool
    ) -> list[float]:
        """Heights from south to north and west to east, at nodes from the south-west ``corner``."""
        (south_deg, west_deg), (north_step, east_step), (rows, columns) = corner, steps, counts
        resampling = self._rasterio.enums.Resampling
        west_edge_deg, north_edge_deg = west_deg - east_step / 2.0, south_deg + north_step * (rows - 0.5)
        with self._rasterio.vrt.WarpedVRT(
            self._file,
            crs=_MAP,
            transform=self._rasterio.Affine(east_step, 0.0, west_edge_deg, 0.0, -north_step, north_edge_deg),
            width=columns,
            height=rows,
            # A coarse grid keeps the tops: a mean would make ridges lower than they are.
            resampling=resampling.max if coarse else resampling.bilinear,
            dtype="float64",
            nodata=NO_HEIGHT_M,
        ) as warped:
            found = warped.read(1)[::-1].ravel().tolist()
        scale, offset = self._file.scales[0] * self._metres, self._file.offsets[0] * self._metres
        heights = [
            height * scale + offset if math.isfinite(height) and height != NO_HEIGHT_M else NO_HEIGHT_M
            for height in found
        ]
        lowest_m, highest_m = _GROUND_M
        for height in heights:
            if height != NO_HEIGHT_M and not lowest_m <= height <= highest_m:
                raise HeightModelError(
                    f"{self._name} has heights of {height:,.9g} m there: holes that it does not declare.",
                    hint="Declare their value, such as -9999: `gdal_translate -a_nodata -9999 FILE NEW`.",
                )
        return heights

    def _steps_deg(self, middle: Place) -> tuple[float, float]:
        """The size of a pixel there, in degrees of latitude and longitude."""
        transform, crs = self._file.transform, self._file.crs
        (x,), (y,) = self._rasterio.warp.transform(_MAP, crs, [middle[1]], [middle[0]])
        xs, ys = [x, x + transform.a, x + transform.b], [y, y + transform.d, y + transform.e]
        east, north = self._rasterio.warp.transform(crs, _MAP, xs, ys)
        if not all(map(math.isfinite, (*east, *north))):
            raise HeightModelError(
                f"{middle[0]:.6f}, {middle[1]:.6f} is outside of the CRS of {self._name}.", hint=_HINT
            )
        north_deg = max(abs(value - north[0]) for value in north[1:])
        east_deg = max(abs((value - east[0] + 180.0) % 360.0 - 180.0) for value in east[1:])
        return max(north_deg, _FINEST_DEG), max(east_deg, _FINEST_DEG)

    def _unit(self) -> float:
        """Metres in a unit of its heights; raises ``HeightModelError`` also for other files than heights."""
        if self._file.count != 1:
            raise HeightModelError(
                f"{self._name} is no height model: it has {self._file.count} bands.", hint=_HINT
            )
        if self._file.crs is None:
            raise HeightModelError(
                f"{self._name} says no CRS.",
                hint="Give it the one that it was made in: `gdal_translate -a_srs EPSG:… FILE NEW`.",
            )
        unit = (self._file.units[0] or "").lower()
        metres = _US_FOOT_M if "us" in unit.split() or unit == "us-ft" else _UNITS_M.get(unit)
        if metres is None:
            raise HeightModelError(f"{self._name} has heights in {unit!r}.", hint="Convert them to metres.")
        return metres

    def _heights_above(self) -> AltitudeDatum:
        crs = self._file.crs.to_dict(projjson=True)
        axes = crs.get("coordinate_system", {}).get("axis", ())
        return AltitudeDatum.ELLIPSOID if len(axes) == 3 else AltitudeDatum.SEA_LEVEL


def _counts(extent_deg: tuple[float, float], steps: tuple[float, float]) -> tuple[int, int]:
    """Rows and columns over an extent, with a margin."""
    rows, columns = (
        math.ceil(extent / step) + 1 + 2 * _MARGIN for extent, step in zip(extent_deg, steps, strict=True)
    )
    return rows, columns


def _rasterio() -> Any:
    try:
        import rasterio
        import rasterio.vrt
        import rasterio.warp
    except ImportError as error:
        raise HeightModelError(
            "Height models need rasterio.", hint="Install it: pip install 'fvs-client[terrain]'."
        ) from error
    return rasterio
