"""``fvs-client mission``."""

import json
import math
from collections.abc import Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

import pydantic
import typer

from fvs_client import AltitudeDatum, Autopilot, Drone, Finish, MissionFormat, Tour
from fvs_client.cli.flight_options import (
    GeofenceOption,
    HighestOption,
    LowestOption,
    TransitHeightOption,
    flight_limits,
)
from fvs_client.cli.ground import MissionGroundOption
from fvs_client.cli.options import JsonOption, within
from fvs_client.cli.output import print_json
from fvs_client.cli.session import service
from fvs_client.height_model import HeightModel, places_of
from fvs_client.models.plans import PlanData
from fvs_schema.mistakes import described
from fvs_schema.plans import Stop
from fvs_schema.poses import Pose, frame_of
from fvs_schema.rankings import RankedCandidate
from fvs_schema.scenes import Origin
from fvs_schema.terrain import Terrain, TerrainOfPoints
from fvs_schema.words import POINTS

_RANKING, _PLAN, _SNAPSHOT = "rnk_", "pln_", "snp_"
_PLANS = "`fvs-client plan --json` writes plans."
_HOMES = "LAT,LON or LAT,LON,ALT"


def mission(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(
            metavar="RANKING|PLAN|SNAPSHOT",
            help="An id, or a file of `fvs-client plan --json`. Photographs of a snapshot are taken again.",
        ),
    ],
    format: Annotated[  # noqa: A002
        MissionFormat, typer.Option("--format", "-f", help="What the mission is written for.")
    ] = MissionFormat.QGC_PLAN,
    out: Annotated[
        str, typer.Option(metavar="PATH", help="File to write, or folder; a new folder ends with a slash.")
    ] = ".",
    vehicle: Annotated[
        int, typer.Option(min=1, max=20, metavar="N", help="The vehicle of a plan, counted from 1.")
    ] = 1,
    first: Annotated[
        int | None, typer.Option(min=1, max=100_000, metavar="N", help="Only the first N views.")
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(
            metavar=_HOMES, help="Where the vehicle takes off; the altitude is above the scene's datum."
        ),
    ] = None,
    home_above_takeoff: Annotated[
        float | None,
        typer.Option(
            min=-10_000,
            max=10_000,
            metavar="M",
            help="How much higher home is than the place where the flight of the newest photographs took off "
            "(0: the same place), by their relative altitudes; instead of ALT in --home.",
        ),
    ] = None,
    altitudes: Annotated[
        AltitudeDatum | None,
        typer.Option(
            help="Datum of the altitudes in the file.",
            show_default="takeoff if home's altitude is given, else the scene's",
        ),
    ] = None,
    geoid: Annotated[
        float | None,
        typer.Option(
            min=-150, max=150, metavar="M", help="Height of the geoid above the ellipsoid at the site."
        ),
    ] = None,
    transit_height: TransitHeightOption = None,
    lowest: LowestOption = None,
    highest: HighestOption = None,
    geofence: GeofenceOption = None,
    terrain: MissionGroundOption = None,
    above_ground: Annotated[
        bool,
        typer.Option(
            "--above-ground",
            help="Write altitudes above the ground (QGroundControl's terrain frame), whose heights the "
            "vehicle must know; with --terrain. By default the terrain is in the altitudes.",
        ),
    ] = False,
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Leave out views that cannot be flown.")
    ] = False,
    battery: Annotated[
        float | None,
        typer.Option(
            min=10,
            max=100_000,
            metavar="S",
            help="How long the vehicle flies on one battery. Cuts the mission into numbered files, each of "
            "which begins and ends at home; `--out` is a folder. Needs home and its altitude.",
        ),
    ] = None,
    reserve: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=0.9,
            metavar="SHARE",
            help="The share of the battery with which it lands; with --battery.",
            show_default="0.3",
        ),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.1, max=50, metavar="M/S", help="Speed between views.", show_default="5"),
    ] = None,
    acceptance: Annotated[
        float | None,
        typer.Option(
            min=0.05,
            max=100,
            metavar="M",
            help="Distance from a waypoint at which it counts as reached.",
            show_default="1",
        ),
    ] = None,
    hold: Annotated[
        float | None,
        typer.Option(
            min=0, max=600, metavar="S", help="How long to hold still before a photograph.", show_default="4"
        ),
    ] = None,
    gimbal: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Range of the gimbal's pitch, in degrees.",
            show_default="-90 30",
            callback=within((-180, 180), (-180, 180)),
        ),
    ] = None,
    takeoff: Annotated[
        bool, typer.Option("--takeoff/--in-the-air", help="Begin with a takeoff, if home is given.")
    ] = True,
    finish: Annotated[Finish, typer.Option(help="What to do after the last view.")] = Finish.RETURN,
    autopilot: Annotated[Autopilot, typer.Option(help="Firmware that reads MAVLink commands.")] = (
        Autopilot.ARDUPILOT
    ),
    drone: Annotated[Drone, typer.Option(help="Aircraft of a DJI mission.")] = Drone.M3E,
    as_json: JsonOption = False,
) -> None:
    """Write a ranking, plan, or snapshot's photographs as a mission for an autopilot or a ground station."""
    settings: dict[str, Any] = {
        "first": first,
        **_home(home),
        "home_above_takeoff_m": home_above_takeoff,
        **flight_limits(transit_height, lowest, highest, geofence),
        "altitude_datum": altitudes,
        "geoid_height_m": geoid,
        "above_ground": above_ground or None,
        "leave_out": leave_out,
        "battery_s": battery,
        "battery_reserve": reserve,
        "speed_m_s": speed,
        "acceptance_radius_m": acceptance,
        "hold_s": hold,
        "gimbal_lowest_deg": None if gimbal is None else gimbal[0],
        "gimbal_highest_deg": None if gimbal is None else gimbal[1],
        "takeoff": takeoff,
        "finish": finish,
        "autopilot": autopilot,
        "drone": drone,
    }
    given = {name: value for name, value in settings.items() if value is not None}
    plan = None if what.startswith((_RANKING, _PLAN, _SNAPSHOT)) else _plan(Path(what))
    with service(context, as_json=as_json) as client:
        if what.startswith(_SNAPSHOT):
            if terrain not in (None, POINTS):
                raise typer.BadParameter("With a snapshot it is `points`.", param_hint="--terrain")
            scene = client.scenes.get(client.snapshots.get(what).scene_id)
            given |= {"snapshot_id": what, "terrain": _ground(terrain, (), (), None, home)}
            write = partial(scene.mission_of_images, format, **given)
        elif what.startswith(_RANKING) and terrain is None:
            write = partial(client.rankings.get(what).mission, format, **given)
        elif what.startswith(_RANKING):
            ranking = client.rankings.get(what)
            ranked = [item for item in ranking.candidates if item.rank is not None]
            ground = _ground(terrain, ranked[:first], (), ranking.origin, home)
            scene = client.scenes.get(ranking.scene_id)
            given |= {"snapshot_id": _needed(ranking.snapshot_id, ranked, ()), "terrain": ground}
            write = partial(scene.mission, ranked, format, **given)
        elif plan is None and terrain is None:
            write = partial(client.plans.get(what).mission, format, vehicle=vehicle, **given)
        else:
            plan = plan or client.plans.get(what)
            tour = _tour(plan, vehicle)
            ground = _ground(terrain, tour.stops[:first], tour.via_home, plan.origin, home)
            scene = client.scenes.get(plan.scene_id)
            given |= {"snapshot_id": _needed(plan.snapshot_id, tour.stops, tour.via_home), "terrain": ground}
            write = partial(scene.mission, tour, format, **given)
        file = write()
        folder = out if battery is None else f"{out}/"
        paths = [file.save(folder)]
        paths += [write(part=part).save(folder) for part in range(2, file.parts + 1)]
    if as_json:
        print_json(
            {
                "files": [str(path) for path in paths],
                "media_type": file.media_type,
                "left_out": list(file.left_out),
                "reasons": list(file.reasons),
            }
        )
        return
    for path in paths:
        typer.echo(path)
    for view, reason in zip_longest(file.left_out, file.reasons):
        why = f": {reason}" if reason else ""
        typer.echo(f"Warning: {view} is left out{why}.", err=True)


def _tour(plan: PlanData, vehicle: int) -> Tour:
    if vehicle > len(plan.tours):
        vehicles = "1 vehicle" if len(plan.tours) == 1 else f"{len(plan.tours)} vehicles"
        raise typer.BadParameter(
            f"The plan is for {vehicles}; `--vehicle` counts from 1.", param_hint="--vehicle"
        )
    return plan.tours[vehicle - 1]


def _ground(
    terrain: str | None,
    views: Sequence[RankedCandidate | Stop],
    via_home: Sequence[Pose],
    origin: Origin | None,
    home: str | None,
) -> Terrain | TerrainOfPoints | None:
    """The height model around a flight, or the ground by points."""
    if terrain is None:
        return None
    given = _home(home)
    if not given:
        raise typer.BadParameter("With --terrain, home must be given.", param_hint="--home")
    if terrain == POINTS:
        return TerrainOfPoints()
    via = (pose for view in views if isinstance(view, Stop) for pose in view.via)
    places = places_of([*(view.pose for view in views), *via, *via_home], origin)
    with HeightModel(terrain) as heights:
        return heights.around([(given["home_latitude_deg"], given["home_longitude_deg"]), *places])


def _needed(
    snapshot_id: str, views: Sequence[RankedCandidate | Stop], via_home: Sequence[Pose]
) -> str | None:
    """The snapshot, if poses are in its frame: for others it may have been deleted."""
    via = (pose for view in views if isinstance(view, Stop) for pose in view.via)
    poses = [*(view.pose for view in views), *via, *via_home]
    return snapshot_id if any(frame_of(pose) == "model" for pose in poses) else None


def _plan(path: Path) -> PlanData:
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise typer.BadParameter(
            f"{path} is no id of a ranking, plan or snapshot, and no file: {error.strerror}."
        ) from error
    except ValueError as error:
        raise typer.BadParameter(f"{path}: It is no JSON: {error}. {_PLANS}") from error
    try:
        return PlanData.model_validate(document)
    except pydantic.ValidationError as error:
        raise typer.BadParameter(f"{path}: {described(error, document)} {_PLANS}") from error


def _home(text: str | None) -> dict[str, float]:
    if text is None:
        return {}
    names = ("home_latitude_deg", "home_longitude_deg", "home_altitude_m")
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise typer.BadParameter(f"{text!r} is not {_HOMES}.", param_hint="--home")
    return dict(zip(names, numbers, strict=False))
