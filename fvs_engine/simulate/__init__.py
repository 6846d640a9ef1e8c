"""A made-up world that can be photographed from any pose, when there are no photographs."""

from fvs_engine.simulate.camera import SimulatedCamera
from fvs_engine.simulate.photographs import write_photographs
from fvs_engine.simulate.tours import orbit
from fvs_engine.simulate.world import Rectangle, World, courtyard

__all__ = ["Rectangle", "SimulatedCamera", "World", "courtyard", "orbit", "write_photographs"]
