"""The demonstration of a flight, ``make demo-flight``: a simulated copter photographs a courtyard on its own.

Starts the service and the copter, flies a survey, then from view to view: each is the first of a ranking by
the model of all photographs before. Leaves a picture of the flight, and what the model showed of each view.
"""

import argparse
import io
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from fvs_client import AltitudeDatum, Client, EnuWorld, FvsError, Orbit, Origin, Scene, VehiclePose
from fvs_client.fly.flight import Flight, FlightSettings
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from fvs_service.errors import ServiceError
from fvs_service.serving.running import running_service
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, geodetic_from_enu
from fvs_engine.lab.simulate import courtyard

FVS = Path(sys.executable).with_name("fvs")
HOME = GeodeticPosition(47.3769, 8.5417, 440.0)
RADIUS_M, HEIGHT_M = 30.0, 13.0
LOWEST_M, HIGHEST_M = 5.0, 40.0
SCALE = 10.0
"""How much larger the courtyard is than the one of `fvs_engine.lab.simulate`."""
SPEED_UP = 10
REACH_M = 18.0
"""Views farther than this from the one before share too little with it to be registered."""
console = Console()


def main() -> None:
    """Run the demonstration with the arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/demo-flight"), help="where the results go")
    parser.add_argument("--views", type=int, default=16, help="how many photographs in all")
    parser.add_argument("--survey-views", type=int, default=8, help="how many of them in the survey")
    parser.add_argument("--method", default="kriging", help="of ranking")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that everything is stopped then, too
    options.out.mkdir(parents=True, exist_ok=True)
    log = options.out / "flight.jsonl"
    log.unlink(missing_ok=True)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fvs-demo-flight-") as folder:
        camera = Path(folder) / "camera"
        camera.mkdir()
        try:
            with (
                running_service(Path(folder) / "service", options.out / "service.log") as service,
                _copter(camera, options.out / "copter.log") as url,
                Client(service.url) as client,
            ):
                scene = client.scenes.create("flight", world=EnuWorld(origin=_origin()))
                _fly(scene, url, camera, service.url, log, options)
                _draw(options.out / "flight.png", client, log, camera)
        except (FvsError, ServiceError) as error:
            raise SystemExit(f"{error}\n{error.hint}\nThe logs are in {options.out}") from error
    console.print(f"Look at  {options.out}/flight.png")
    console.print(f"Done in {time.monotonic() - began:.0f} s; the service and the copter have been stopped.")


@contextmanager
def _copter(camera: Path, log: Path) -> Iterator[str]:
    """A simulated copter; yields where it speaks MAVLink."""
    with log.open("w") as written:
        command = [
            str(FVS),
            "simulate-vehicle",
            str(camera),
            "--listen",
            "127.0.0.1:0",
            "--size",
            "480",
            "360",
        ]
        command += [
            "--scale",
            str(SCALE),
            "--seed",
            "0",
            "--speed-up",
            str(SPEED_UP),
            "--wind",
            "3,1",
            "--gusts",
            "1",
            "--endurance",
            "9000",
        ]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=written, text=True)
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            if not line.startswith("Listening on "):
                raise SystemExit(f"The copter did not start: see {log}")
            yield line.split()[-1]
        finally:
            process.terminate()
            process.wait()


def _origin() -> Origin:
    return Origin(
        latitude_deg=HOME.latitude_deg,
        longitude_deg=HOME.longitude_deg,
        altitude_m=HOME.altitude_m,
        altitude_datum=AltitudeDatum.SEA_LEVEL,
    )


def _fly(scene: Scene, url: str, camera: Path, service: str, log: Path, options: argparse.Namespace) -> None:
    survey = Survey(
        HOME.latitude_deg, HOME.longitude_deg, RADIUS_M, HEIGHT_M, 5.0, options.survey_views, arc_deg=100.0
    )
    settings = FlightSettings(
        vehicle="copter",
        photographs=options.views,
        method=options.method,
        generator=Orbit(count=48, radius_m=RADIUS_M),
        radius_m=REACH_M,
        survey=survey,
        patience_s=6_000.0,
        iterations=300,
        long_side_px=240,
        mission={"lowest_height_m": LOWEST_M, "highest_height_m": HIGHEST_M, "geofence": _fence()},
    )

    def say(line: str) -> None:
        console.print(line, highlight=False)

    sending = Photographs(camera, scene.id, url=service, api_key=None, say=lambda _line: None)
    with Vehicle(url) as vehicle, sending as photographs:
        result = Flight(scene, vehicle, photographs, settings, FlightLog(log, say)).fly()
    console.print(f"{result.photographs} photographs, {result.failed} failed, {result.unsent} unsent.")


def _draw(path: Path, client: Client, log: Path, camera: Path) -> None:
    """Draw the flight from above, and its heights over time; of each chosen view what the model showed."""
    events = [json.loads(line) for line in log.read_text().splitlines()]
    way = np.array([_enu(event) for event in events if "latitude_deg" in event])
    goes = [event for event in events if event["event"] == "goes"]
    photographs = [event for event in events if event["event"] == "photograph"]
    figure = Figure(figsize=(13.0, max(8.0, 1.4 * len(goes))), layout="constrained")
    plan, strip = figure.subfigures(1, 2, width_ratios=(1.1, 1.0))
    axes, profile = plan.subplots(2, 1, height_ratios=(4.0, 1.0))
    for wall in _walls():
        axes.plot(*wall.T, color="0.75", linewidth=2)
    fence = np.array([_place(*map(float, corner.split(","))) for corner in _fence().split(";")])
    axes.plot(*np.concatenate((fence, fence[:1]))[:, :2].T, color="tab:red", linestyle="--", label="geofence")
    axes.plot(way[:, 0], way[:, 1], color="0.6", linewidth=1, label="flight")
    surveyed = len(photographs) - len(goes)
    views = _looks(client, goes)
    began_s = events[0]["t_s"]
    for number, event in enumerate(photographs):
        east, north, _ = _enu(event)
        color = "0.2" if number < surveyed else "tab:orange"
        axes.scatter(east, north, color=color, s=60, zorder=3)
        look = views.get(
            event.get("candidate", ""), np.array([-east, -north])
        )  # a survey looks at the middle
        axes.quiver(east, north, *(look / np.linalg.norm(look)), color=color, width=0.004, scale=14.0)
        said = f"{number + 1}: {event['height_m']:.0f} m, {event['t_s'] - began_s:.0f} s"
        axes.annotate(said, (east, north), xytext=(6, 4), textcoords="offset points", fontsize=8)
    axes.scatter(0, 0, marker="^", color="tab:green", s=90, zorder=3)
    axes.annotate("home", (0, 0), xytext=(8, 4), textcoords="offset points")
    axes.set(xlabel="east, m", ylabel="north, m", title="Photographs: the survey dark, chosen views orange")
    axes.set_aspect("equal")
    axes.legend(loc="lower right", fontsize=8)
    at_s = np.array([event["t_s"] for event in events if "latitude_deg" in event]) - began_s
    profile.plot(at_s, way[:, 2], color="0.4")
    for limit_m in (LOWEST_M, HIGHEST_M):
        profile.axhline(limit_m, color="tab:red", linestyle=":")
    profile.plot(
        [event["t_s"] - began_s for event in photographs], [event["height_m"] for event in photographs], "o"
    )
    profile.set(xlabel=f"time, s ({SPEED_UP} times as fast as it would be)", ylabel="above home, m")
    if goes:
        pictures = strip.subplots(len(goes), 2, squeeze=False)
        for number, (row, event) in enumerate(zip(pictures, goes, strict=True), surveyed + 1):
            ranking = client.rankings.get(event["ranking_id"])
            (chosen,) = [one for one in ranking.candidates if one.id == event["candidate"]]
            render = Image.open(io.BytesIO(ranking.render(chosen.id)))
            ranked = sum(one.rank is not None for one in ranking.candidates)
            score = "" if chosen.score is None else f", score {chosen.score:.3f}"
            _show(row[0], render, f"{chosen.id}: rank {chosen.rank} of {ranked}{score}")
            taken = [photograph for photograph in photographs if photograph["t_s"] > event["t_s"]]
            if taken:
                _show(row[1], Image.open(camera / taken[0]["file"]), f"photograph {number}")
    figure.savefig(path, dpi=100)


def _walls() -> Iterator[np.ndarray]:
    """The walls of the courtyard and the sides of what is in it, [2, 2] from end to end."""
    for one in courtyard(0).rectangles:
        if one.side_v[2] > 0.0 and not one.side_u[2]:
            yield SCALE * np.stack((one.corner, one.corner + one.side_u))[:, :2]


def _fence() -> str:
    """A square around the orbit, in degrees."""
    half_m = 1.5 * RADIUS_M
    corners = [(half_m, half_m), (half_m, -half_m), (-half_m, -half_m), (-half_m, half_m)]
    places = [geodetic_from_enu(np.array([*corner, 0.0]), HOME) for corner in corners]
    return ";".join(f"{place.latitude_deg:.7f},{place.longitude_deg:.7f}" for place in places)


def _looks(client: Client, goes: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Where the chosen views look, [2] east and north, by id."""
    looks = {}
    for event in goes:
        ranking = client.rankings.get(event["ranking_id"])
        (pose,) = [one.pose for one in ranking.candidates if one.id == event["candidate"]]
        assert isinstance(pose, VehiclePose), "the scene is on Earth"
        yaw = np.deg2rad(pose.yaw_deg)
        looks[event["candidate"]] = np.array([np.sin(yaw), np.cos(yaw)])
    return looks


def _show(axes: Any, image: Image.Image, title: str) -> None:
    axes.imshow(np.asarray(image.convert("RGB")))
    axes.set_title(title, fontsize=8)
    axes.axis("off")


def _enu(event: dict[str, Any]) -> tuple[float, float, float]:
    return _place(event["latitude_deg"], event["longitude_deg"], event["height_m"])


def _place(latitude_deg: float, longitude_deg: float, height_m: float = 0.0) -> tuple[float, float, float]:
    place = GeodeticPosition(latitude_deg, longitude_deg, HOME.altitude_m + height_m)
    east, north, up = enu_from_geodetic(place, HOME)
    return float(east), float(north), float(up)


if __name__ == "__main__":
    main()
