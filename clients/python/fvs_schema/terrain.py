"""Heights of the ground over a rectangle of latitudes and longitudes. Imports nothing heavy."""

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from fvs_schema.base import Input
from fvs_schema.checks import of_fields
from fvs_schema.fence import Place
from fvs_schema.quantities import WHOLE, Latitude, Longitude, Number
from fvs_schema.scenes import AltitudeDatum

MOST_HEIGHTS = 10_000
MOST_IN_A_ROW = 250
"""Most rows, and most columns: each way over a terrain costs as many steps."""
NO_HEIGHT_M = -32_768.0
"""The height of a hole, as SRTM writes it."""
_LOWEST_M = -12_000.0
_ROUNDING = 1e-6
"""Of a step: a place on the edge is inside."""
_Height = Annotated[Number, Field(ge=NO_HEIGHT_M, le=100_000)]
_Step = Annotated[Number, Field(ge=1e-9, le=1)]


class Terrain(Input):
    """Heights of the ground on a grid: a height model around a flight.

    Rows go from south to north, and in a row columns from west to east, also across the antimeridian. Between
    four heights the ground is bilinear; it has no height where one of them is a hole, and outside of the
    grid.
    """

    kind: Literal["heights"] = "heights"
    """The terrain's name."""
    south_deg: Latitude
    """Latitude of the first row."""
    west_deg: Longitude
    """Longitude of the first column."""
    latitude_step_deg: _Step
    """From row to row."""
    longitude_step_deg: _Step
    """From column to column."""
    columns: Annotated[int, Field(strict=True, ge=2, le=MOST_IN_A_ROW), WHOLE]
    """How many columns; there are at most 250, and as many rows."""
    heights_m: Annotated[tuple[_Height, ...], Field(min_length=4, max_length=MOST_HEIGHTS, fail_fast=True)]
    """The heights above `altitude_datum`, row by row; -32768, or any below -12000, is a hole."""
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL
    """What the heights are measured from."""

    @model_validator(mode="after")
    def _whole_rows(self) -> Self:
        if len(self.heights_m) % self.columns or len(self.heights_m) < 2 * self.columns:
            raise of_fields(
                f"{len(self.heights_m)} heights are not two or more rows of {self.columns}",
                "heights_m",
                "columns",
            )
        if len(self.heights_m) // self.columns > MOST_IN_A_ROW:
            raise of_fields(f"there are more than {MOST_IN_A_ROW} rows of heights", "heights_m", "columns")
        return self

    def raised(self, by_m: float, datum: AltitudeDatum) -> "Terrain":
        """The same ground, its heights above another datum, which is ``by_m`` lower."""
        heights = tuple(
            height_m if height_m < _LOWEST_M else max(height_m + by_m, _LOWEST_M)
            for height_m in self.heights_m
        )
        return self.model_copy(update={"heights_m": heights, "altitude_datum": datum})

    def height_m(self, place: Place) -> float | None:
        """The height of the ground at a latitude and longitude; None in a hole and outside."""
        row = (place[0] - self.south_deg) / self.latitude_step_deg
        # Longitudes east of the first column, and by rounding just west of it.
        east_deg = (place[1] - self.west_deg + 90.0) % 360.0 - 90.0
        return self._interpolated(row, east_deg / self.longitude_step_deg)

    def along(self, start: Place, end: Place) -> Iterator[tuple[float, Place]]:
        """Places on the straight way between two places, half a step apart, after their shares of it.

        There may be any number of them outside of the grid: stop where the ground has no height.
        """
        north_deg = end[0] - start[0]
        east_deg = (end[1] - start[1] + 180.0) % 360.0 - 180.0
        steps = 2.0 * max(abs(north_deg) / self.latitude_step_deg, abs(east_deg) / self.longitude_step_deg)
        count = max(1, math.ceil(steps - _ROUNDING))
        for number in range(count + 1):
            share = number / count
            longitude_deg = (start[1] + share * east_deg + 180.0) % 360.0 - 180.0
            yield share, (start[0] + share * north_deg, longitude_deg)

    def _interpolated(self, row: float, column: float) -> float | None:
        heights, columns = self.heights_m, self.columns
        last_row, last_column = len(heights) // columns - 1, columns - 1
        if not (-_ROUNDING <= row <= last_row + _ROUNDING):
            return None
        if not (-_ROUNDING <= column <= last_column + _ROUNDING):
            return None
        south, west = min(max(int(row), 0), last_row - 1), min(max(int(column), 0), last_column - 1)
        north_share, east_share = row - south, column - west
        index = south * columns + west
        height_m = 0.0
        for place, share in (
            (index, (1.0 - north_share) * (1.0 - east_share)),
            (index + 1, (1.0 - north_share) * east_share),
            (index + columns, north_share * (1.0 - east_share)),
            (index + columns + 1, north_share * east_share),
        ):
            if abs(share) > _ROUNDING:
                corner_m = heights[place]
                if corner_m < _LOWEST_M:
                    return None
                height_m += share * corner_m
        return height_m


class TerrainOfPoints(Input):
    """The ground by the sparse points of the model: the artifact `terrain.json` of its snapshot."""

    kind: Literal["points"] = "points"
    """The terrain's name."""


AnyTerrain = Annotated[Terrain | TerrainOfPoints, Field(discriminator="kind")]
