"""The file ``gcp_list.txt`` of OpenDroneMap: surveyed points and their marks.

Source: https://docs.opendronemap.org/gcp/ (the documents alone).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from fvs_schema.control_points import ControlPoint, ControlPoints, Mark
from fvs_schema.mistakes import InvalidInput

_COLUMNS = ("geo_x", "geo_y", "geo_z", "im_x", "im_y")
_FORM = "Write geo_x geo_y geo_z im_x im_y image_name [gcp_name], parted by tabs or spaces."
_CHECK = "check"
"""The word in a column after the name that makes a check point."""


class GcpListError(ValueError):
    """The file cannot be used; ``message`` says why and where, ``hint`` what to do."""

    def __init__(self, message: str, *, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass
class _Point:
    """A point as it is read: its coordinates, the number of its first line, and its marks by their images."""

    coordinates: tuple[float, float, float]
    line: int
    check: bool = False
    marks: dict[str, Mark] = field(default_factory=dict)


def read_gcp_list(text: str, file: Path, check: Sequence[str] = ()) -> ControlPoints:
    """The points of the file's ``text``; those that match a pattern in ``check`` are check points.

    So are those with the word ``check`` in a column after the name. Lines of one name, or without a name of
    the same coordinates, are the marks of one point. Raises ``GcpListError`` with the number of the line.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if len(lines) < 2:
        raise GcpListError(f"{file} has no points.", hint=f"Its first line is the CRS. {_FORM}")
    points: dict[str, _Point] = {}
    unnamed: dict[str, str] = {}
    for number, line in lines[1:]:
        try:
            _add(points, unnamed, number, line)
        except GcpListError as error:
            raise GcpListError(f"{file}, line {number}: {error.message}", hint=error.hint) from error
    unmatched = [pattern for pattern in check if not any(fnmatchcase(name, pattern) for name in points)]
    if unmatched:
        raise GcpListError(
            f"No point of {file} is named {unmatched[0]}.",
            hint=f"Its first is {next(iter(points))}.",
        )
    try:
        return ControlPoints(
            crs=lines[0][1],
            points=tuple(
                ControlPoint(
                    name=name,
                    x=point.coordinates[0],
                    y=point.coordinates[1],
                    z=None if math.isnan(point.coordinates[2]) else point.coordinates[2],
                    check=point.check or any(fnmatchcase(name, pattern) for pattern in check),
                    marks=tuple(point.marks.values()),
                )
                for name, point in points.items()
            ),
        )
    except InvalidInput as error:
        raise GcpListError(f"{file} cannot be used: {error}.", hint=_FORM) from error


def _add(points: dict[str, _Point], unnamed: dict[str, str], number: int, line: str) -> None:
    """Add the mark of a line to its point; ``unnamed``: place → name of the points that have none."""
    # Between tabs the names of images may have spaces.
    columns = [column.strip() for column in line.split("\t")] if line.count("\t") >= 5 else line.split()
    if len(columns) < 6:
        raise GcpListError(f"it has {len(columns)} columns, and needs six or more.", hint=_FORM)
    x, y, z, im_x, im_y = map(_number, _COLUMNS, columns)
    coordinates, (image, *rest) = (x, y, z), columns[5:]
    place = str(coordinates)  # NaN is not equal to itself
    name = rest[0] if rest and rest[0] else unnamed.setdefault(place, f"point-{len(points) + 1}")
    point = points.setdefault(name, _Point(coordinates, number))
    if str(point.coordinates) != place:
        raise GcpListError(
            f"{name} has other coordinates than in line {point.line}.",
            hint="Give different points different names.",
        )
    point.check |= _CHECK in (extra.lower() for extra in rest[1:])
    if image in point.marks:
        raise GcpListError(f"{name} has a second mark in {image}.", hint="Leave one of the two out.")
    try:
        point.marks[image] = Mark(image=image, x_px=im_x, y_px=im_y)
    except InvalidInput as error:
        raise GcpListError(
            f"its mark in {image} is at {im_x:g}, {im_y:g} px.", hint="Pixels count from the top left corner."
        ) from error


def _number(column: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError as error:
        raise GcpListError(f"{column} is {text}, which is not a number.", hint=_FORM) from error
    if math.isfinite(number) or (column == "geo_z" and math.isnan(number)):
        return number
    raise GcpListError(f"{column} is {text}.", hint=_FORM)
