"""The command ``fvs simulate-vehicle``: a vehicle in a made-up or replayed world that speaks MAVLink."""

import signal
import threading
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.choices import CameraReports, Firmware
from fvs_engine.cli.options import MAX_SEED

if TYPE_CHECKING:
    from fvs_engine.geometry.geodetic import GeodeticPosition
    from fvs_engine.lab.simulate import SimulatedCamera
    from fvs_engine.lab.simulate.replay import ReplayPlace
    from fvs_engine.lab.simulate.scenery import Scenery

_ORIGIN_FORM = "LATITUDE,LONGITUDE,ALTITUDE"
_WIND_FORM = "EAST,NORTH"
_SIZE = (640, 480)


def simulate_vehicle(
    photographs: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that the camera writes its photographs to.")
    ],
    listen: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LINK",
            help="Where ground stations connect: HOST:PORT, with TCP, or udpin:HOST:PORT; udpout:HOST:PORT "
            "sends to one. May be repeated.",
            show_default="127.0.0.1:5760",
        ),
    ] = None,
    firmware: Annotated[
        Firmware,
        typer.Option("--autopilot", help="The autopilot whose modes, commands and parameters it has."),
    ] = "ardupilot",
    origin: Annotated[
        str,
        typer.Option(metavar=_ORIGIN_FORM, help="Home, in the middle of the world: degrees and m above sea."),
    ] = "47.3769,8.5417,440",
    scale: Annotated[
        float, typer.Option(min=1.0, max=100.0, help="Enlarge the courtyard, whose walls are 8 m long.")
    ] = 10.0,
    replay: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN",
            help="Fly in the model of an output folder of `fvs reconstruct`, instead of the courtyard.",
            show_default=False,
        ),
    ] = None,
    distance: Annotated[
        float,
        typer.Option(
            min=0.1, max=10_000.0, metavar="M", help="Replay: the cameras' median distance from home."
        ),
    ] = 30.0,
    lowest: Annotated[
        float,
        typer.Option(min=0.1, max=1_000.0, metavar="M", help="Replay: the height of the lowest camera."),
    ] = 6.0,
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Replay: write the photographs' poses, as candidates for `fvs-client fly --candidates`.",
            show_default=False,
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Append the true pose of each photograph to a file, as lines of JSON.",
            show_default=False,
        ),
    ] = None,
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(
            min=64,
            max=4096,
            metavar="W H",
            help="Size of the photographs in px; a replay has the size of the model's photographs.",
            show_default="640 480",
        ),
    ] = None,
    auto_exposure: Annotated[
        bool,
        typer.Option("--auto-exposure", help="Expose all photographs to the same brightness."),
    ] = False,
    shutter: Annotated[
        float,
        typer.Option(
            min=0.0, max=1.0, metavar="S", help="Exposure time; motion during it blurs the photograph."
        ),
    ] = 0.004,
    gps_noise: Annotated[
        float,
        typer.Option(min=0.0, max=100.0, metavar="M", help="Standard deviation of the noise of a GPS fix."),
    ] = 1.5,
    gps_bias: Annotated[
        float, typer.Option(min=0.0, max=100.0, metavar="M", help="Bias of the GPS receiver, which drifts.")
    ] = 0.5,
    fix_after: Annotated[
        float,
        typer.Option(
            min=0.0, max=1_000.0, metavar="S", help="How long the GPS receiver has no fix after the start."
        ),
    ] = 8.0,
    camera_reports: Annotated[
        CameraReports,
        typer.Option(
            help="What tells of photographs: ArduPilot's `feedback`, alone for a camera on a wire, or a "
            "camera that speaks MAVLink (`captured`)."
        ),
    ] = "both",
    signing_key: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="Sign messages, and ignore unsigned ones: a file with the passphrase of the key.",
            show_default=False,
        ),
    ] = None,
    wind: Annotated[
        str,
        typer.Option(
            metavar=_WIND_FORM, help="Velocity of the wind in m/s, in the direction that it blows to."
        ),
    ] = "0,0",
    gusts: Annotated[
        float, typer.Option(min=0.0, max=30.0, metavar="M/S", help="Standard deviation of the wind.")
    ] = 0.0,
    endurance: Annotated[
        float, typer.Option(min=10.0, max=100_000.0, metavar="S", help="How long the battery lasts.")
    ] = 1500.0,
    speed_up: Annotated[
        float,
        typer.Option(min=0.1, max=50.0, help="Run the simulation this many times faster than real time."),
    ] = 1.0,
    fail: Annotated[
        list[int] | None,
        typer.Option(
            min=0,
            max=1_000_000,
            metavar="N",
            help="Let photograph N, counted from 0, fail; may be repeated.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the world and all errors.")] = 0,
) -> None:
    """Simulate a copter with a camera, until Ctrl-C; it speaks MAVLink as ArduPilot or PX4 does.

    It flies over a made-up courtyard, or in a model of real photographs (--replay). Photographs have the
    position of the GPS receiver in EXIF and in a JSON file beside them. Needs the extra `simulate`.
    """
    try:
        from fvs_engine.lab.simulate.mavlink.autopilot import Autopilot, Setup
    except ModuleNotFoundError as error:
        typer.echo("Error: MAVLink needs pymavlink: install fvs with the extra `simulate`.", err=True)
        raise typer.Exit(2) from error
    from fvs_engine.cli.jobs import fail as end
    from fvs_engine.errors import EngineError
    from fvs_engine.geometry.geodetic import GeodeticPosition
    from fvs_engine.lab.simulate.replay import ReplayPlace
    from fvs_engine.lab.simulate.vehicle import GpsErrors, Vehicle, Wind
    from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

    latitude, longitude, altitude = _numbers(origin, 3, _ORIGIN_FORM, "--origin")
    east, north = _numbers(wind, 2, _WIND_FORM, "--wind")
    home = GeodeticPosition(latitude, longitude, altitude)
    vehicle = Vehicle(
        wind=Wind((east, north), gusts),
        gps=GpsErrors(gps_noise, gps_bias),
        endurance_s=endurance,
        seed=seed,
    )
    if replay is not None and size is not None:
        raise typer.BadParameter("A replay has the size of the model's photographs.", param_hint="--size")
    if replay is None and poses is not None:
        raise typer.BadParameter("The courtyard has no photographs: give --replay.", param_hint="--poses")
    try:
        _prepare_files(photographs, truth)
        if replay is None:
            scenery, sensor = _courtyard(seed, scale, size or _SIZE)
        else:
            scenery, sensor = _replay(replay, ReplayPlace(distance, lowest), home, poses)
    except EngineError as error:
        end(error, machine=False)
    camera = VehicleCamera(
        photographs,
        scenery,
        home,
        sensor,
        exposure_s=shutter,
        auto_exposure=auto_exposure,
        truth=truth,
        seed=seed,
    )
    key = None if signing_key is None else sha256(signing_key.read_bytes().strip()).digest()
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    links = [each if each.count(":") > 1 else f"tcpin:{each}" for each in listen or ["127.0.0.1:5760"]]
    try:
        autopilot = Autopilot(
            links,
            vehicle,
            camera,
            home,
            firmware=firmware,
            setup=Setup(camera_reports, fix_after, key),
            speed_up=speed_up,
            say=typer.echo,
        )
    except (OSError, ValueError) as error:
        typer.echo(f"Error: {' and '.join(links)} cannot be opened: {error}.", err=True)
        raise typer.Exit(2) from error
    autopilot.faults.failing_photographs.update(fail or ())
    typer.echo(f"Listening on {' and '.join(autopilot.urls)}")
    autopilot.run(stopped.is_set)
    autopilot.close()


def _prepare_files(photographs: Path, truth: Path | None) -> None:
    """Create what a flight writes to; raises ``StorageError``, which else would come in flight."""
    from fvs_engine.files.storage import storage_errors

    with storage_errors(photographs):
        photographs.mkdir(parents=True, exist_ok=True)
    if truth is not None:
        with storage_errors(truth), truth.open("a", encoding="utf-8"):
            pass


def _courtyard(seed: int, scale: float, size: tuple[int, int]) -> "tuple[Scenery, SimulatedCamera]":
    from fvs_engine.lab.simulate import SimulatedCamera, courtyard
    from fvs_engine.lab.simulate.scenery import MadeUpScenery

    sensor = SimulatedCamera.like_a_drone(*size)
    return MadeUpScenery(courtyard(seed), sensor.camera, scale), sensor


def _replay(
    root: Path, place: "ReplayPlace", home: "GeodeticPosition", poses: Path | None
) -> "tuple[Scenery, SimulatedCamera]":
    """A replay world; says where its photographs were taken, and writes their poses where asked to."""
    import numpy as np

    from fvs_engine.lab.simulate import SimulatedCamera
    from fvs_engine.lab.simulate.replay import open_replay, write_poses

    scenery = open_replay(root, place)
    heights = np.array([view.centre[2] for view in scenery.views])
    away = np.array([np.hypot(*view.centre[:2]) for view in scenery.views])
    typer.echo(
        f"{len(scenery.views)} photographs, {away.min():.0f} to {away.max():.0f} m from home, "
        f"{heights.min():.0f} to {heights.max():.0f} m high; most look at {scenery.target_height_m:.0f} m"
    )
    if poses is not None:
        write_poses(poses, scenery.views, home)
    # The vignetting of the real camera is in the photographs that the model was trained on.
    return scenery, SimulatedCamera(scenery.camera, vignetting=0.0)


def _numbers(text: str, count: int, form: str, option: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise typer.BadParameter(f"{text!r} is not {form}.", param_hint=option)
    return numbers
