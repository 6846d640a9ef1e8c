"""Simulated photographs of a synthetic scene."""

from fvs_engine.simulate.camera import SimulatedCamera
from fvs_engine.simulate.photographs import write_photographs
from fvs_engine.simulate.tours import orbit
from fvs_engine.simulate.world import Rectangle, World, courtyard

__all__ = ["Rectangle", "SimulatedCamera", "World", "courtyard", "orbit", "write_photographs"]
