"""A room made of splats, and cameras in it: a scene of any size that needs no photographs."""

import math

import numpy as np
import torch

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView


def scene(count: int, seed: int = 0) -> Gaussians:
    """A room as splats: on five walls and on a dozen balls in it, of sizes as training leaves them."""
    generator = np.random.default_rng(seed)
    walls = generator.uniform(-4, 4, (count // 2, 3))
    side = generator.integers(0, 5, len(walls))
    walls[np.arange(len(walls)), side // 2] = np.where(side % 2 == 0, 4.0, -4.0)
    directions = generator.normal(size=(count - len(walls), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ball = generator.integers(0, 12, len(directions))
    radii, centres = generator.uniform(0.2, 0.7, (12, 1)), generator.uniform(-1.5, 1.5, (12, 3))
    balls = centres[ball] + radii[ball] * directions
    spacing = math.sqrt(5 * 64 / count)
    return Gaussians(
        means=_tensor(np.concatenate([walls, balls])),
        log_scales=_tensor(np.log(0.5 * spacing) + generator.normal(scale=0.6, size=(count, 3))),
        quaternions_wxyz=_tensor(generator.normal(size=(count, 4))),
        opacity_logits=_tensor(generator.normal(1.0, 2.0, size=count)),
        sh_dc=_tensor(generator.normal(scale=0.8, size=(count, 3))),
        sh_rest=torch.zeros(count, 0, 3),
    )


def candidates(count: int, width: int, height: int) -> list[PinholeView]:
    """Cameras on a circle in the room that look across it."""
    camera = PinholeCamera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2)
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return [
        PinholeView(
            f"view {i}",
            camera,
            look_at([3.5 * np.cos(a), 3.5 * np.sin(a), 0.5], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).inverse(),
        )
        for i, a in enumerate(angles)
    ]


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))
