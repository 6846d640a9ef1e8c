"""``fvs-client mission``."""

import json
from pathlib import Path
from typing import Annotated, Any

import pydantic
import typer

from fvs_client import Autopilot, Client, Drone, Finish, MissionFile, MissionFormat, Plan
from fvs_client.cli.options import JsonOption, within
from fvs_client.cli.output import print_json
from fvs_client.cli.session import service

_RANKING = "rnk_"
_HOMES = "LAT,LON or LAT,LON,ALT"


def mission(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(metavar="RANKING|PLAN", help="A ranking's id, or a file of `fvs-client plan --json`."),
    ],
    format: Annotated[  # noqa: A002
        MissionFormat, typer.Option("--format", "-f", help="What it is written for.")
    ] = MissionFormat.QGC_PLAN,
    out: Annotated[Path, typer.Option(metavar="PATH", help="File or folder to write to.")] = Path(),
    vehicle: Annotated[
        int, typer.Option(min=0, max=19, metavar="N", help="Of a plan: the vehicle, from 0.")
    ] = 0,
    first: Annotated[
        int | None, typer.Option(min=1, max=100_000, metavar="N", help="Only the first N views.")
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(
            metavar=_HOMES, help="Where the vehicle takes off; the altitude is above the scene's datum."
        ),
    ] = None,
    altitudes: Annotated[
        str | None,
        typer.Option(
            metavar="DATUM",
            help="What altitudes in the file are above: takeoff, sea-level or ellipsoid.",
            show_default="takeoff if home's altitude is given, else the scene's",
        ),
    ] = None,
    geoid: Annotated[
        float | None,
        typer.Option(min=-150, max=150, metavar="M", help="Height of the geoid above the ellipsoid here."),
    ] = None,
    transit: Annotated[
        float | None,
        typer.Option(
            min=-10_000,
            max=10_000,
            metavar="M",
            help="Fly from view to view M above home.",
            show_default="straight",
        ),
    ] = None,
    heights: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Fly between these heights above home.",
            callback=within((-10_000, 10_000), (-10_000, 10_000)),
        ),
    ] = None,
    geofence: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, metavar="FILE", help="JSON: stay inside [[lat, lon], …], a polygon."
        ),
    ] = None,
    leave_out: Annotated[
        bool, typer.Option("--leave-out", help="Leave out views that cannot be flown.")
    ] = False,
    speed: Annotated[
        float | None, typer.Option(min=0.1, max=50, metavar="M/S", help="Speed.", show_default="5")
    ] = None,
    acceptance: Annotated[
        float | None,
        typer.Option(
            min=0.05, max=100, metavar="M", help="How near a waypoint counts as reached.", show_default="1"
        ),
    ] = None,
    hold: Annotated[
        float | None,
        typer.Option(
            min=0, max=600, metavar="S", help="How long to stand still before a photograph.", show_default="4"
        ),
    ] = None,
    gimbal: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Range of the gimbal's pitch.",
            show_default="-90 30",
            callback=within((-180, 180), (-180, 180)),
        ),
    ] = None,
    takeoff: Annotated[
        bool, typer.Option("--takeoff/--in-the-air", help="Begin with a takeoff, if home is given.")
    ] = True,
    finish: Annotated[Finish, typer.Option(help="What to do after the last view.")] = Finish.RETURN,
    autopilot: Annotated[Autopilot, typer.Option(help="Firmware of MAVLink commands.")] = (
        Autopilot.ARDUPILOT
    ),
    drone: Annotated[Drone, typer.Option(help="Aircraft of a DJI mission.")] = Drone.M3E,
    as_json: JsonOption = False,
) -> None:
    """Write a ranking, or a plan, as a mission for an autopilot or a ground station."""
    settings: dict[str, Any] = {
        "first": first,
        **_home(home),
        "altitude_datum": altitudes,
        "geoid_height_m": geoid,
        "transit_height_m": transit,
        "lowest_height_m": None if heights is None else heights[0],
        "highest_height_m": None if heights is None else heights[1],
        "geofence": None if geofence is None else _corners(geofence),
        "leave_out": leave_out,
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
    plan = None if what.startswith(_RANKING) else _plan(Path(what))
    with service(context, as_json=as_json) as client:
        if plan is None:
            file = client.rankings.get(what).mission(format, **given)
        else:
            file = _of_plan(client, plan, vehicle, format, given)
    path = file.save(out)
    if as_json:
        print_json({"file": str(path), "media_type": file.media_type, "left_out": list(file.left_out)})
        return
    typer.echo(path)
    for view in file.left_out:
        typer.echo(f"Warning: {view} cannot be flown and was left out.", err=True)


def _of_plan(
    client: Client,
    plan: Plan,
    vehicle: int,
    wanted: MissionFormat,
    settings: dict[str, Any],
) -> MissionFile:
    if vehicle >= len(plan.tours):
        raise typer.BadParameter(f"The plan has {len(plan.tours)} vehicles, from 0.")
    scene = client.scenes.get(plan.scene_id)
    return scene.mission(plan.tours[vehicle], wanted, snapshot_id=plan.snapshot_id, **settings)


def _plan(path: Path) -> Plan:
    try:
        return Plan.model_validate_json(path.read_bytes())
    except OSError as error:
        raise typer.BadParameter(f"{path} is no ranking's id, and cannot be read: {error}") from error
    except pydantic.ValidationError as error:
        reason = error.errors()[0]["msg"]
        raise typer.BadParameter(f"{path}: {reason}. `fvs-client plan --json` writes plans.") from error


def _home(text: str | None) -> dict[str, float]:
    if text is None:
        return {}
    names = ("home_latitude_deg", "home_longitude_deg", "home_altitude_m")
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise typer.BadParameter(f"{text!r} is not {_HOMES}.")
    return dict(zip(names, numbers, strict=False))


def _corners(path: Path) -> str:
    try:
        corners = pydantic.TypeAdapter(list[tuple[float, float]]).validate_python(
            json.loads(path.read_text(encoding="utf-8"))
        )
    except ValueError as error:
        raise typer.BadParameter(f"{path} is no polygon. Write [[46.01, 7.74], [46.03, 7.74], …].") from error
    return ";".join(f"{latitude_deg!r},{longitude_deg!r}" for latitude_deg, longitude_deg in corners)
