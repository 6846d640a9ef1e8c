"""Simulated courtyards whose walls look alike, as scenes of the calibration of the gate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from gate_models import Scene

from fvs_engine.choices import LookAlike
from fvs_engine.geometry import RigidTransform
from fvs_engine.lab.simulate import (
    SimulatedCamera,
    courtyard,
    look_around,
    lookalike_courtyard,
    orbit,
    write_photographs,
)
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import read_dataset

_PHOTOGRAPHS = 28
_SIZE_PX = (720, 540)


@dataclass(frozen=True)
class Yard:
    """Walls that are ``alike``, None if all differ, photographed on a ``tour`` of so many poses."""

    alike: LookAlike | None
    tour: Callable[[int], list[RigidTransform]]
    seed: int = 0


_TOURS = (("", orbit), ("-around", look_around))

YARDS: Mapping[str, Yard] = {
    **{
        f"yard-{alike}{way}": Yard(alike, tour)
        for alike in ("four", "two", "windows")
        for way, tour in _TOURS
    },
    **{f"yard-two{way}-unseen": Yard("two", tour, seed=1) for way, tour in _TOURS},
    **{f"yard-unlike{way}-unseen": Yard(None, tour, seed=1) for way, tour in _TOURS},
}
"""Orbits that look inwards, and, with *around*, tours that look outwards at the walls alone.

No threshold was chosen with those that are *unseen* in view.
"""


def yard(name: str, cache: Path) -> Scene:
    """One of ``YARDS``, photographed into ``cache`` unless it is there."""
    folder, made = cache / name / "photographs", YARDS[name]
    camera = SimulatedCamera.like_a_drone(*_SIZE_PX)
    poses = made.tour(_PHOTOGRAPHS)
    world = courtyard(made.seed) if made.alike is None else lookalike_courtyard(made.alike, made.seed)
    write_photographs(folder, world, camera, poses, Monitor())
    centres = read_dataset(folder / "images", transforms=folder / "transforms.json").centres()
    return Scene(name, folder / "images", centres)
