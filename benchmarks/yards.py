"""Simulated courtyards whose walls look alike, as scenes of the calibration of the gate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from gate_models import Scene

from fvs_engine.choices import LookAlike
from fvs_engine.geometry import RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import read_dataset
from fvs_engine.simulate import SimulatedCamera, look_around, lookalike_courtyard, orbit, write_photographs

_PHOTOGRAPHS = 28
_SIZE_PX = (720, 540)


@dataclass(frozen=True)
class Yard:
    """Walls that are ``alike``, photographed on a ``tour`` of so many poses."""

    alike: LookAlike
    tour: Callable[[int], list[RigidTransform]]


YARDS: Mapping[str, Yard] = {
    f"yard-{alike}{suffix}": Yard(alike, tour)
    for alike in ("four", "two", "windows")
    for suffix, tour in (("", orbit), ("-around", look_around))
}
"""Orbits that look inwards, and, with the suffix *around*, tours that look outwards at the walls alone."""


def yard(name: str, cache: Path) -> Scene:
    """One of ``YARDS``, photographed into ``cache`` unless it is there."""
    folder, made = cache / name / "photographs", YARDS[name]
    camera = SimulatedCamera.like_a_drone(*_SIZE_PX)
    poses = made.tour(_PHOTOGRAPHS)
    write_photographs(folder, lookalike_courtyard(made.alike), camera, poses, Monitor())
    centres = read_dataset(folder / "images", transforms=folder / "transforms.json").centres()
    return Scene(name, folder / "images", centres)
