"""Candidates and poses on the command line, shared by ``rank`` and ``plan``."""

import json
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

import pydantic
import typer

from fvs_client import FramePose, VehiclePose
from fvs_client.models.rankings import AroundCurrent, Candidate, Dataset, Generator, Grid, Orbit, Pose
from fvs_client.models.volumes import Volume

T = TypeVar("T")

_POSE_FORM = '{"position": [x, y, z], "orientation_wxyz": [w, x, y, z]}'
_VOLUME_FORM = (
    '{"kind": "box", "centre": [x, y, z], "size": [x, y, z]}, or a cylinder, prism, shell, corridor'
)
_CANDIDATES_FORM = f'[{{"id": "left", "pose": {_POSE_FORM}}}, …]'


class GeneratorName(StrEnum):
    """Generators of candidates."""

    ORBIT = "orbit"
    GRID = "grid"
    DATASET = "dataset"
    AROUND_CURRENT = "around-current"


class FrameName(StrEnum):
    """Frames of poses."""

    WORLD = "world"
    MODEL = "model"
    GEODETIC = "geodetic"


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


def pose_text(pose: FramePose | VehiclePose) -> str:
    """A pose in a table."""
    if isinstance(pose, VehiclePose):
        return (
            f"{pose.latitude_deg:.6f} {pose.longitude_deg:.6f} {pose.altitude_m:.1f} m, "
            f"yaw {pose.yaw_deg:.0f}° pitch {pose.pitch_deg:.0f}°"
        )
    return " ".join(f"{part:.2f}" for part in pose.position)


def generator_of(name: GeneratorName, count: int | None) -> Generator:
    """The generator with a name; ``count`` is that of its candidates, where it has one."""
    match name:
        case GeneratorName.ORBIT:
            return Orbit() if count is None else Orbit(count=count)
        case GeneratorName.AROUND_CURRENT:
            return AroundCurrent() if count is None else AroundCurrent(count=count)
        case GeneratorName.GRID:
            return Grid()
        case GeneratorName.DATASET:
            return Dataset()


def _read(path: Path, kind: pydantic.TypeAdapter[T], form: str) -> T:
    try:
        return kind.validate_python(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        reason = str(error)
        if isinstance(error, pydantic.ValidationError):
            first = error.errors()[0]
            reason = ": ".join(filter(None, [".".join(map(str, first["loc"])), first["msg"]]))
        raise typer.BadParameter(f"{path}: {reason}. Write {form}.") from error
