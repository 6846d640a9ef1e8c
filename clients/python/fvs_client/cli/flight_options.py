"""Options that limit where a vehicle flies, shared by `fly` and `mission`."""

from pathlib import Path
from typing import Annotated

import typer

from fvs_client.models.missions import MissionSettings

TransitHeightOption = Annotated[
    float | None,
    typer.Option(
        "--transit-height",
        min=-10_000,
        max=10_000,
        metavar="M",
        help="Fly from view to view at this height above home; with --terrain above the highest ground on "
        "the way.",
        show_default="straight",
    ),
]
LowestOption = Annotated[
    float | None,
    typer.Option(
        "--lowest",
        min=-10_000,
        max=10_000,
        metavar="M",
        help="The lowest height of views above home; with --terrain "
        "also of the ways to them, above the ground.",
    ),
]
HighestOption = Annotated[
    float | None,
    typer.Option(
        "--highest",
        min=-10_000,
        max=10_000,
        metavar="M",
        help="The greatest height of the flight above home; with --terrain above the ground.",
    ),
]
TerrainOption = Annotated[
    Path | None,
    typer.Option(
        "--terrain",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="A height model, such as a GeoTIFF in any CRS: heights are above its ground instead of home. "
        "Needs the extra `terrain` of fvs-client.",
        show_default=False,
    ),
]
GeofenceOption = Annotated[
    str | None,
    typer.Option(
        "--geofence",
        metavar="LAT,LON;LAT,LON;…",
        help="A polygon to stay inside, in degrees.",
        show_default=False,
    ),
]


def flight_limits(
    transit_height_m: float | None,
    lowest_m: float | None,
    highest_m: float | None,
    geofence: str | None,
) -> MissionSettings:
    """The settings of a mission that these options give."""
    settings = MissionSettings()
    if transit_height_m is not None:
        settings["transit_height_m"] = transit_height_m
    if lowest_m is not None:
        settings["lowest_height_m"] = lowest_m
    if highest_m is not None:
        settings["highest_height_m"] = highest_m
    if geofence is not None:
        settings["geofence"] = geofence
    return settings
