"""Sceneries that a simulated vehicle photographs: the light that reaches its camera from anywhere."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.cameras import Camera
from fvs_engine.lab.simulate.tracing import PackedWorld, pixel_corner_rays, trace
from fvs_engine.lab.simulate.world import World

Array = NDArray[np.float64]


class Scenery(Protocol):
    """The surroundings of a vehicle, in ENU metres around its home."""

    @property
    def camera(self) -> Camera:
        """The camera of all photographs."""
        ...

    def light(self, world_from_camera: RigidTransform) -> Array:
        """Linear light [H, W, 3] in [0, 1] that reaches the camera's pixels."""
        ...


class MadeUpScenery:
    """A made-up ``world``, ``scale`` times as large as it was made."""

    def __init__(self, world: World, camera: Camera, scale: float = 1.0) -> None:
        self.camera = camera
        self._packed, self._scale, self._corner_rays = PackedWorld(world), scale, pixel_corner_rays(camera)

    def light(self, world_from_camera: RigidTransform) -> Array:
        """See ``Scenery``."""
        made_from_camera = RigidTransform(
            world_from_camera.rotation, world_from_camera.translation / self._scale
        )
        return trace(self._packed, self._corner_rays, made_from_camera)
