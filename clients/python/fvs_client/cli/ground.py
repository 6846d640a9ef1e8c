"""The ground of commands that rank, plan and write missions: a height model, or the points of the model."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from fvs_client import Candidate, FramePose, Scene, Terrain, TerrainOfPoints
from fvs_client.height_model import HeightModel, places_of
from fvs_schema.words import POINTS

_AROUND_M = 500.0
"""How far around the scene's origin candidates of a generator are compared with the ground."""


def _given(terrain: str | None) -> str | None:
    if terrain not in (None, POINTS) and not Path(terrain).is_file():
        raise typer.BadParameter(f"There is no file {terrain}; `{POINTS}` means the model's sparse points.")
    return terrain


def _option(what: str) -> Any:
    return typer.Option(
        "--terrain",
        metavar=f"FILE|{POINTS}",
        help=f"A height model, such as a GeoTIFF in any CRS (needs the extra `terrain` of fvs-client), or "
        f"`{POINTS}`, the ground by the model's sparse points: {what}",
        callback=_given,
        show_default=False,
    )


GroundOption = Annotated[
    str | None,
    _option("candidates under it are left out. Heights of a file have the datum of the scene's altitudes."),
]
MissionGroundOption = Annotated[str | None, _option("heights are above it instead of home.")]


def ground_of(
    terrain: str | None, scene: Scene, candidates: Iterable[Candidate]
) -> Terrain | TerrainOfPoints | None:
    """The height model around candidates, or around the scene's origin; None without one."""
    if terrain is None:
        return None
    if terrain == POINTS:
        return TerrainOfPoints()
    poses = [candidate.pose for candidate in candidates]
    if not poses:
        poses = [FramePose(position=(0.0, 0.0, 0.0), orientation_wxyz=(1.0, 0.0, 0.0, 0.0))]
    with HeightModel(terrain) as heights:
        return heights.around(places_of(poses, scene.origin), _AROUND_M)
