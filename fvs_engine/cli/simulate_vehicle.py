"""The command ``fvs simulate-vehicle``: a vehicle in a made-up world that speaks MAVLink."""

import signal
import threading
from pathlib import Path
from typing import Annotated

import typer

from fvs_engine.cli.options import MAX_SEED

_ORIGIN_FORM = "LATITUDE,LONGITUDE,ALTITUDE"
_WIND_FORM = "EAST,NORTH"


def simulate_vehicle(
    photographs: Annotated[Path, typer.Argument(metavar="DIR", help="Where its camera writes photographs.")],
    listen: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where ground stations connect, with MAVLink over TCP.")
    ] = "127.0.0.1:5760",
    origin: Annotated[
        str,
        typer.Option(metavar=_ORIGIN_FORM, help="Home, in the middle of the world: degrees and m above sea."),
    ] = "47.3769,8.5417,440",
    scale: Annotated[
        float, typer.Option(min=1.0, max=100.0, help="Enlarge the courtyard, whose walls are 8 m long.")
    ] = 10.0,
    size: Annotated[
        tuple[int, int], typer.Option(min=64, max=4096, metavar="W H", help="Size of the photographs in px.")
    ] = (640, 480),
    gps_noise: Annotated[
        float, typer.Option(min=0.0, max=100.0, metavar="M", help="Noise of a fix: standard deviation.")
    ] = 1.5,
    gps_bias: Annotated[
        float, typer.Option(min=0.0, max=100.0, metavar="M", help="Bias of the receiver, which drifts.")
    ] = 0.5,
    wind: Annotated[str, typer.Option(metavar=_WIND_FORM, help="Where the wind blows to, in m/s.")] = "0,0",
    gusts: Annotated[
        float, typer.Option(min=0.0, max=30.0, metavar="M/S", help="Standard deviation of the wind.")
    ] = 0.0,
    endurance: Annotated[
        float, typer.Option(min=10.0, max=100_000.0, metavar="S", help="How long the battery lasts.")
    ] = 1500.0,
    speed_up: Annotated[
        float, typer.Option(min=0.1, max=50.0, help="Simulated time passes so many times as fast.")
    ] = 1.0,
    fail: Annotated[
        list[int] | None,
        typer.Option(
            min=0,
            max=1_000_000,
            metavar="N",
            help="Photograph N, from 0, fails; once for each.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the world and all errors.")] = 0,
) -> None:
    """Simulate a copter with a camera over a courtyard, until Ctrl-C; it speaks MAVLink like ArduPilot's.

    Photographs have the receiver's fix in EXIF and a sidecar. Needs the extra `simulate`.
    """
    try:
        from fvs_engine.simulate.mavlink.autopilot import Autopilot
    except ModuleNotFoundError as error:
        typer.echo("Error: MAVLink needs pymavlink: pip install 'fvs[simulate]'.", err=True)
        raise typer.Exit(2) from error
    from fvs_engine.geometry.geodetic import GeodeticPosition
    from fvs_engine.simulate import SimulatedCamera, courtyard
    from fvs_engine.simulate.vehicle import GpsErrors, Vehicle, Wind
    from fvs_engine.simulate.vehicle_camera import VehicleCamera

    latitude, longitude, altitude = _numbers(origin, 3, _ORIGIN_FORM, "--origin")
    east, north = _numbers(wind, 2, _WIND_FORM, "--wind")
    home = GeodeticPosition(latitude, longitude, altitude)
    photographs.mkdir(parents=True, exist_ok=True)
    vehicle = Vehicle(
        wind=Wind((east, north), gusts),
        gps=GpsErrors(gps_noise, gps_bias),
        endurance_s=endurance,
        seed=seed,
    )
    camera = VehicleCamera(
        photographs, courtyard(seed), home, SimulatedCamera.like_a_drone(*size), scale, seed=seed
    )
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    try:
        autopilot = Autopilot(f"tcpin:{listen}", vehicle, camera, home, speed_up=speed_up, say=typer.echo)
    except (OSError, ValueError) as error:
        typer.echo(f"Error: {listen} cannot be listened on: {error}.", err=True)
        raise typer.Exit(2) from error
    autopilot.faults.failing_photographs.update(fail or ())
    typer.echo(f"Listening on {autopilot.url}")
    autopilot.run(stopped.is_set)
    autopilot.close()


def _numbers(text: str, count: int, form: str, option: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise typer.BadParameter(f"{text!r} is not {form}.", param_hint=option)
    return numbers
