"""Candidates and poses on the command line, shared by ``rank`` and ``plan``."""

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import pydantic
import typer

from fvs_schema.candidates import AroundCurrent, Candidate, Dataset, Generator, Grid, InVolume, Orbit
from fvs_schema.mistakes import described
from fvs_schema.poses import Pose
from fvs_schema.volumes import Volume

T = TypeVar("T")

_POSE_FORM = '{"position": [x, y, z], "orientation_wxyz": [w, x, y, z]}'
_VOLUME_FORM = (
    '{"kind": "box", "centre": [x, y, z], "size": [x, y, z]}, or a cylinder, prism, shell, corridor'
)
_CANDIDATES_FORM = f'[{{"id": "left", "pose": {_POSE_FORM}}}, …]'


PlanGenerator = Literal["orbit", "grid", "dataset", "in-volume"]
FlightGenerator = Literal["orbit", "grid", "dataset", "around-current"]
RankingGenerator = Literal[PlanGenerator, "around-current"]


class FrameName(StrEnum):
    """Frames of poses."""

    WORLD = "world"
    MODEL = "model"
    GEODETIC = "geodetic"


GENERATOR = typer.Option("--generator", help="Generator of candidates.", show_default="orbit")
FrameOption = Annotated[
    FrameName | None,
    typer.Option(
        "--frame",
        help="Frame of the poses in the result.",
        show_default="as asked; geodetic if georeferenced",
    ),
]


def read_candidates(path: Path | None) -> list[Candidate] | None:
    """The candidates of a file, if one is given."""
    return None if path is None else _read(path, pydantic.TypeAdapter(list[Candidate]), _CANDIDATES_FORM)


def read_pose(path: Path) -> Pose:
    """The pose in a file."""
    pose: Pose = _read(path, pydantic.TypeAdapter(Pose), _POSE_FORM)
    return pose


def read_volume(path: Path) -> Volume:
    """The volume in a file."""
    volume: Volume = _read(path, pydantic.TypeAdapter(Volume), _VOLUME_FORM)
    return volume


def generator_asked(
    candidates: Path | None,
    generator: RankingGenerator | None,
    count: int | None,
    volume: Path | None,
    aim: str | None,
    *,
    level: bool,
) -> Generator | None:
    """The generator that the options ask for; None where they give candidates, or nothing."""
    if generator == "in-volume":
        if volume is None:
            raise typer.BadParameter("in-volume needs a --volume.", param_hint="--generator")
        generator = None
    if sum(given is not None for given in (candidates, generator, volume)) > 1:
        raise typer.BadParameter("Give --candidates, --generator or --volume, not both.")
    if volume is None and (aim is not None or level):
        raise typer.BadParameter("--aim and --level need a --volume: other candidates have their directions.")
    if count is not None and (candidates is not None or generator in ("grid", "dataset")):
        raise typer.BadParameter("--count is for orbit, around-current and --volume.")
    if volume is not None:
        return _in_volume(volume, count, aim, level=level)
    if generator is not None or (candidates is None and count is not None):
        return generator_of(generator or "orbit", count)
    return None


def generator_of(name: FlightGenerator, count: int | None) -> Generator:
    """The generator with a name; ``count`` is that of its candidates, where it has one."""
    match name:
        case "orbit":
            return Orbit() if count is None else Orbit(count=count)
        case "around-current":
            return AroundCurrent() if count is None else AroundCurrent(count=count)
        case "grid":
            return Grid()
        case "dataset":
            return Dataset()


def _in_volume(path: Path, count: int | None, aim: str | None, *, level: bool) -> InVolume:
    given: dict[str, Any] = {"volume": read_volume(path), "level": level}
    if count is not None:
        given["count"] = count
    if aim in ("middle", "nearest"):
        given["look"] = aim
    elif aim is not None:
        try:
            x, y, z = (float(part) for part in aim.split(","))
            return InVolume(**given, aim=(x, y, z))
        except ValueError as error:
            raise typer.BadParameter(f"{aim!r} is not middle, nearest or X,Y,Z") from error
    return InVolume(**given)


def _read(path: Path, kind: pydantic.TypeAdapter[T], form: str) -> T:
    try:
        document = json.loads(path.read_bytes())  # UTF-8, -16 or -32, with a byte order mark or without
    except ValueError as error:
        raise typer.BadParameter(f"{path}: It is no JSON: {error}. Write {form}.") from error
    try:
        return kind.validate_python(document)
    except pydantic.ValidationError as error:
        raise typer.BadParameter(f"{path}: {described(error, document)} Write {form}.") from error
