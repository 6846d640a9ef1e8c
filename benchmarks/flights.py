"""Flights for benchmarks: a simulated copter as a process, and where its photographs were really taken."""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fvs_client import AltitudeDatum, EnuWorld, Origin

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at

FVS = Path(sys.executable).with_name("fvs")
HOME = GeodeticPosition(47.3769, 8.5417, 440.0)
WORLD = EnuWorld(
    origin=Origin(
        latitude_deg=HOME.latitude_deg,
        longitude_deg=HOME.longitude_deg,
        altitude_m=HOME.altitude_m,
        altitude_datum=AltitudeDatum.SEA_LEVEL,
    )
)
FIELD = ("--gps-noise", "1.5", "--gps-bias", "0.5", "--wind", "3,1", "--gusts", "1")
"""Errors of the receiver and wind, as the simulator's options."""


@dataclass(frozen=True)
class Truth:
    """Where a photograph was really taken, in ENU metres around home, and how far the vehicle had flown."""

    file: str
    world_from_camera: RigidTransform
    flown_m: float


def read_truth(path: Path) -> list[Truth]:
    """What the simulator wrote with ``--truth``."""
    found = []
    for line in path.read_text().splitlines():
        told = json.loads(line)
        pose = camera_at(np.array(told["enu_m"]), told["yaw_deg"], told["pitch_deg"])
        found.append(Truth(told["file"], pose, told["flown_m"]))
    return found


@contextmanager
def copter(camera: Path, log: Path, arguments: Sequence[str]) -> Iterator[str]:
    """A simulated copter that writes its photographs into ``camera``; yields where it speaks MAVLink."""
    camera.mkdir(parents=True, exist_ok=True)
    with log.open("a") as written:
        process = subprocess.Popen(
            [str(FVS), "simulate-vehicle", str(camera), "--listen", "127.0.0.1:0", *arguments],
            stdout=subprocess.PIPE,
            stderr=written,
            text=True,
        )
        assert process.stdout is not None
        try:
            lines = iter(process.stdout.readline, "")
            listening = next((line for line in lines if line.startswith("Listening on ")), None)
            if listening is None:
                raise SystemExit(f"The copter did not start: see {log}")
            yield listening.split()[-1]
        finally:
            process.terminate()
            process.wait()
