"""The ground under candidates: the option of commands that rank and plan."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Candidate, FramePose, Scene, Terrain
from fvs_client.height_model import HeightModel, places_of

_AROUND_M = 200.0
"""How far around the scene's origin candidates of a generator are compared with the ground."""

GroundOption = Annotated[
    Path | None,
    typer.Option(
        "--terrain",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="A height model, such as a GeoTIFF in any CRS; candidates under it are left out. Its heights "
        "have the datum of the scene's altitudes. Needs the extra `terrain` of fvs-client.",
        show_default=False,
    ),
]


def ground_of(path: Path | None, scene: Scene, candidates: Iterable[Candidate]) -> Terrain | None:
    """The height model around candidates, or around the scene's origin; None without one."""
    if path is None:
        return None
    poses = [candidate.pose for candidate in candidates]
    if not poses:
        poses = [FramePose(position=(0.0, 0.0, 0.0), orientation_wxyz=(1.0, 0.0, 0.0, 0.0))]
    with HeightModel(path) as heights:
        return heights.around(places_of(poses, scene.origin), _AROUND_M)
