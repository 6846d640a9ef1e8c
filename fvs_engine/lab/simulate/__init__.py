"""Simulated photographs of synthetic scenes."""

from fvs_engine.lab.simulate.camera import SimulatedCamera
from fvs_engine.lab.simulate.facades import lookalike_courtyard
from fvs_engine.lab.simulate.photographs import write_photographs
from fvs_engine.lab.simulate.tours import look_around, orbit, survey
from fvs_engine.lab.simulate.world import Rectangle, World, courtyard, settlement

__all__ = [
    "Rectangle",
    "SimulatedCamera",
    "World",
    "courtyard",
    "look_around",
    "lookalike_courtyard",
    "orbit",
    "settlement",
    "survey",
    "write_photographs",
]
