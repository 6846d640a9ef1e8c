"""Simulated camera: lens, exposure, vignetting, noise, quantisation to 8 bits."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import DistortedCamera, RigidTransform
from fvs_engine.geometry.cameras import Camera
from fvs_engine.lab.simulate.tracing import Array, PackedWorld, pixel_corner_rays, trace

GAMMA = 2.2
_FULL_WELL, _READ_NOISE = 8000.0, 0.002


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera model with exposure, vignetting and noise.

    ``exposure_ev`` brightens by 2^ev; ``vignetting`` in [0, 1] is the light lost in the corners;
    ``full_well`` is how many electrons a white pixel holds (shot noise falls with its root; None: none);
    ``read_noise`` is the sensor's own noise as a share of white. Raises ``InvalidInputError`` for values out
    of range.
    """

    camera: Camera
    exposure_ev: float = 0.0
    vignetting: float = 0.15
    full_well: float | None = _FULL_WELL
    read_noise: float = _READ_NOISE

    def __post_init__(self) -> None:
        if not 0 <= self.vignetting <= 1 or self.read_noise < 0 or (self.full_well or 1.0) <= 0:
            raise InvalidInputError("Vignetting is in [0, 1], noise not negative, a full well positive.")

    @classmethod
    def like_a_drone(
        cls, width: int = 640, height: int = 480, exposure_ev: float = 0.0, noise: float = 1.0
    ) -> "SimulatedCamera":
        """A wide lens (75° across) with the barrel distortion of a small drone's camera, and its sensor.

        ``noise`` scales the standard deviation of all noise; 0 switches it off.
        """
        focal = 0.65 * width
        return cls(
            DistortedCamera("RADIAL", width, height, (focal, width / 2, height / 2, -0.06, 0.008)),
            exposure_ev=exposure_ev,
            full_well=_FULL_WELL / noise**2 if noise > 0 else None,
            read_noise=_READ_NOISE * noise,
        )

    @cached_property
    def _corner_rays(self) -> Array:
        return pixel_corner_rays(self.camera)

    def photograph(
        self, world: PackedWorld, world_from_camera: RigidTransform, seed: int
    ) -> NDArray[np.uint8]:
        """A photograph [H, W, 3]; ``seed`` fixes its noise."""
        return self.develop(trace(world, self._corner_rays, world_from_camera), seed)

    def develop(self, light: Array, seed: int) -> NDArray[np.uint8]:
        """The photograph [H, W, 3] of linear light [H, W, 3] in [0, 1]; ``seed`` fixes its noise."""
        light = light * 2.0**self.exposure_ev * self._falloff
        generator = np.random.default_rng(seed)
        if self.full_well is not None:
            light = light + generator.normal(size=light.shape) * np.sqrt(light / self.full_well)
        light = light + generator.normal(scale=self.read_noise, size=light.shape)
        pixels: NDArray[np.uint8] = np.round(255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / GAMMA)).astype(
            np.uint8
        )
        return pixels

    @cached_property
    def _falloff(self) -> Array:
        """Share of the light [H, W, 1] that is left: 1 in the middle, 1 − vignetting in the corners."""
        height, width = self.camera.height, self.camera.width
        y = (np.arange(height) + 0.5) / height - 0.5
        x = (np.arange(width) + 0.5) / width - 0.5
        return np.asarray(1.0 - self.vignetting * 2.0 * (y[:, None] ** 2 + x[None, :] ** 2))[..., None]
