"""``fvs-client fly``."""

import os
import signal
import sys
import threading
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from fvs_client import FvsError
from fvs_client.cli.exit_codes import NOT_FLOWN
from fvs_client.cli.flight_options import (
    GeofenceOption,
    HighestOption,
    LowestOption,
    TerrainOption,
    TransitHeightOption,
    flight_limits,
)
from fvs_client.cli.options import (
    CandidatesOption,
    IterationsOption,
    JsonOption,
    LongSideOption,
    MethodOption,
    SceneArgument,
)
from fvs_client.cli.output import print_json
from fvs_client.cli.poses import GENERATOR, FlightGenerator, generator_of, read_candidates
from fvs_client.cli.program import Target
from fvs_client.cli.session import find_scene, service
from fvs_client.fly.checklist import Check
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending, Flight, FlightSettings
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from fvs_client.height_model import HeightModel, HeightModelError
from fvs_client.service_url import DEFAULT_URL
from fvs_client.spool.errors import SpoolError
from fvs_schema.fence import Fence

_DONE = frozenset({Ending.BUDGET, Ending.BATTERY, Ending.STOPPED, Ending.GOOD_ENOUGH})
_SURVEY_FORM = "LATITUDE,LONGITUDE,RADIUS,HEIGHT"


def fly(
    context: typer.Context,
    scene: SceneArgument,
    vehicle: Annotated[
        str,
        typer.Option(
            metavar="URL", help="The autopilot: tcp:HOST:PORT, udpin:0.0.0.0:14550 or a serial device."
        ),
    ],
    photographs: Annotated[
        Path,
        typer.Option(
            exists=True,
            file_okay=False,
            metavar="FOLDER",
            help="Folder that the camera writes its photographs to.",
        ),
    ],
    system: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=254,
            metavar="ID",
            help="The vehicle's MAVLink id, if several are on the link.",
            show_default=False,
        ),
    ] = None,
    unchecked: Annotated[
        bool,
        typer.Option(
            "--unchecked", help="Fly even if the vehicle reports no camera, no gimbal or no battery."
        ),
    ] = False,
    baud: Annotated[
        int, typer.Option(min=1_200, max=4_000_000, metavar="N", help="Baud rate of a serial device.")
    ] = 57_600,
    signing_key: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="File with the passphrase of a vehicle that signs its messages, as in Mission Planner or "
            "MAVProxy.",
            show_default=False,
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Take off without asking whether the checklist is confirmed.")
    ] = False,
    take_over: Annotated[
        bool,
        typer.Option("--take-over", help="Fly a vehicle that somebody else has armed, or flies."),
    ] = False,
    name: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Name of the vehicle; rankings for other vehicles leave its views out."
        ),
    ] = "vehicle-1",
    views: Annotated[
        int, typer.Option(min=1, max=10_000, metavar="N", help="Number of photographs of the whole flight.")
    ] = 20,
    leg: Annotated[
        int,
        typer.Option(
            min=1,
            max=100,
            metavar="N",
            help="Photograph N views of a plan before the next update, instead of the first of a ranking.",
        ),
    ] = 1,
    safety: Annotated[
        float | None,
        typer.Option(
            min=0, max=2e7, metavar="M", help="Minimum distance from anything in the model; with --leg."
        ),
    ] = None,
    method: MethodOption = "median-frequency",
    generator: Annotated[FlightGenerator | None, GENERATOR] = None,
    count: Annotated[
        int | None, typer.Option(min=1, max=2_000, help="Number of candidates for orbit and around-current.")
    ] = None,
    candidates: CandidatesOption = None,
    radius: Annotated[
        float | None,
        typer.Option(min=0, max=1e9, metavar="M", help="In the air, only views within M of the vehicle."),
    ] = None,
    survey: Annotated[
        str | None,
        typer.Option(
            metavar=_SURVEY_FORM,
            help="Where the scene has no model: first fly a circle around a point, in degrees and in m "
            "above home, or with --terrain above the ground.",
            show_default=False,
        ),
    ] = None,
    survey_views: Annotated[
        int, typer.Option(min=3, max=200, metavar="N", help="Number of photographs of the survey.")
    ] = 8,
    survey_target: Annotated[
        float,
        typer.Option(
            min=-1_000,
            max=10_000,
            metavar="M",
            help="Height above home of the point that the survey looks at; with --terrain above the ground.",
        ),
    ] = 0.0,
    survey_arc: Annotated[
        float, typer.Option(min=1, max=360, metavar="DEG", help="Part of the circle that the survey flies.")
    ] = 100.0,
    survey_start: Annotated[
        float,
        typer.Option(
            min=-360,
            max=360,
            metavar="DEG",
            help="Where the survey begins, clockwise from north of the point.",
        ),
    ] = 0.0,
    reserve: Annotated[
        float,
        typer.Option(min=0, max=1, metavar="SHARE", help="Return home when the battery falls to this share."),
    ] = 0.3,
    patience: Annotated[
        float,
        typer.Option(
            min=5,
            max=3_600,
            metavar="S",
            help="How long the vehicle waits for its next view before it returns home.",
        ),
    ] = 300.0,
    stop_at_db: Annotated[
        float | None,
        typer.Option(min=0, max=100, metavar="DB", help="Stop when the expected PSNR reaches this value."),
    ] = None,
    transit_height: TransitHeightOption = None,
    lowest: LowestOption = None,
    highest: HighestOption = None,
    geofence: GeofenceOption = None,
    upload_fence: Annotated[
        bool,
        typer.Option("--upload-fence", help="Replace the vehicle's own fence by --geofence, before takeoff."),
    ] = False,
    terrain: TerrainOption = None,
    geoid: Annotated[
        float | None,
        typer.Option(
            min=-150,
            max=150,
            metavar="M",
            help="Height of the geoid above the ellipsoid at the site, for scenes above the ellipsoid.",
            show_default=False,
        ),
    ] = None,
    speed: Annotated[float, typer.Option(min=0.1, max=50, metavar="M/S", help="Speed between views.")] = 5.0,
    iterations: IterationsOption = None,
    long_side: LongSideOption = None,
    log: Annotated[
        Path | None, typer.Option(dir_okay=False, metavar="FILE", help="Append events as lines of JSON.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Fly a vehicle from view to view: rank, fly, photograph, send, update the model, repeat.

    Before takeoff it prints a checklist and asks whether to take off.
    Ctrl-C sends it home; a second one ends this program, and leaves the vehicle to its autopilot. Lines on a
    terminal: `pause`, `resume`, `home`. Needs the extra `fly` of fvs-client.
    """
    if candidates is not None and generator is not None:
        raise typer.BadParameter("Give --candidates or --generator, not both.")
    if leg == 1 and safety is not None:
        raise typer.BadParameter(
            "Only plans keep away from the solid parts of the model: give --leg, of 2 or more.",
            param_hint="--safety",
        )
    if leg > 1 and generator == "around-current":
        raise typer.BadParameter(
            "A plan has no candidates around a place: give another --generator, or --leg 1."
        )
    listed = read_candidates(candidates)
    if geofence is not None:
        try:
            Fence.parse(geofence)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="--geofence") from error
    elif upload_fence:
        raise typer.BadParameter("There is no fence to upload: give --geofence.", param_hint="--upload-fence")
    mission = flight_limits(transit_height, lowest, highest, geofence)
    mission["speed_m_s"] = speed
    if geoid is not None:
        mission["geoid_height_m"] = geoid
    try:
        heights = None if terrain is None else HeightModel(terrain)
    except HeightModelError as error:
        raise typer.BadParameter(f"{error.message} {error.hint}", param_hint="--terrain") from error
    settings = FlightSettings(
        vehicle=name,
        photographs=views,
        method=method,
        generator=generator_of(generator or "orbit", count) if listed is None else None,
        candidates=None if listed is None else tuple(listed),
        radius_m=radius,
        leg_views=leg,
        safety_m=safety,
        equipment=not unchecked,
        take_over=take_over,
        survey=None
        if survey is None
        else _survey(survey, survey_target, survey_views, survey_start, survey_arc),
        reserve=reserve,
        patience_s=patience,
        iterations=iterations,
        long_side_px=long_side,
        stop_at_db=stop_at_db,
        mission=mission,
        upload_fence=upload_fence,
        terrain=heights,
    )
    key = None if signing_key is None else _key(signing_key)
    target: Target = context.find_object(Target) or Target(None, None)

    def say(line: str) -> None:
        typer.echo(line, err=True)

    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        sending = Photographs(
            photographs, found.id, url=target.url or DEFAULT_URL, api_key=target.api_key, say=say
        )
        try:
            with (
                Vehicle(vehicle, system=system, baud=baud, signing_key=key, say=say) as connected,
                sending as sent,
            ):

                def confirm(checks: Sequence[Check]) -> bool:
                    agreed = yes or _agrees(checks)
                    if agreed:
                        _read_commands(flight)
                    return agreed

                flight = Flight(found, connected, sent, settings, FlightLog(log, say), confirm)
                _come_home_on_signals(flight)
                result = flight.fly()
        except SpoolError as error:
            raise VehicleError(str(error), hint=error.hint) from error
    if as_json:
        print_json(vars(result))
    else:
        more = f" {result.unsent} wait in the outbox: `fvs-client spool send`." if result.unsent else ""
        typer.echo(f"{result.photographs} photographs, {result.failed} failed: {result.reason}{more}")
    if result.ending not in _DONE:
        raise typer.Exit(NOT_FLOWN)


def _survey(text: str, target_m: float, count: int, start_deg: float, arc_deg: float) -> Survey:
    try:
        latitude, longitude, radius, height = (float(part) for part in text.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not {_SURVEY_FORM}.", param_hint="--survey") from error
    return Survey(latitude, longitude, radius, height, target_m, count, start_deg=start_deg, arc_deg=arc_deg)


def _key(path: Path) -> bytes:
    """The key of a passphrase, as ground stations make it: its SHA-256."""
    if os.name == "posix" and path.stat().st_mode & 0o077:
        raise typer.BadParameter(f"Others can read {path}: chmod 600.", param_hint="--signing-key")
    passphrase = path.read_bytes().strip()
    if not passphrase:
        raise typer.BadParameter(f"{path} is empty.", param_hint="--signing-key")
    return sha256(passphrase).digest()


def _agrees(checks: Sequence[Check]) -> bool:
    """Ask on the terminal whether to take off."""
    if sys.stdin is None or not sys.stdin.isatty():
        raise VehicleError("Nobody can confirm the checklist here.", hint="--yes takes off without asking.")
    off = sum(not check.fine for check in checks)
    return typer.confirm(f"{off} to look at. Take off?" if off else "Take off?", err=True)


def _come_home_on_signals(flight: Flight) -> None:
    """Ctrl-C and SIGTERM send the vehicle home, once."""

    def home(number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
        flight.return_home()

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, home)
        signal.signal(signal.SIGTERM, home)


def _read_commands(flight: Flight) -> None:
    """Lines on a terminal are commands."""
    if sys.stdin is not None and sys.stdin.isatty():
        threading.Thread(target=_commands, args=(flight,), daemon=True).start()


def _commands(flight: Flight) -> None:
    commands = {"pause": flight.pause, "resume": flight.resume, "home": flight.return_home}
    for line in sys.stdin:
        command = commands.get(line.strip())
        if command is None:
            typer.echo(f"The commands are {', '.join(commands)}.", err=True)
        else:
            try:
                command()
            except FvsError as error:
                typer.echo(f"{error.message} {error.hint}".strip(), err=True)
