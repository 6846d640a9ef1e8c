"""What the proof on a device (``prove.sh``) computes, and ``goldens.py`` on the CPU."""

import io
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from safetensors import safe_open
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parents[1]))

from room import candidates, scene

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.score import MedianFrequency
from fvs_engine.splat.densification import GradientStatistics, densify
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.optimiser import GaussianAdam
from fvs_engine.splat.raster import Rasterizer, Rendering, SquaringRasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.splat.views import TrainingView

HELD_OUT_EVERY = 8
SQUARED = ("means", "log_scales", "opacity_logits", "sh_dc", "sh_rest")

Size = tuple[int, int]


@dataclass(frozen=True)
class Extent:
    """How much is computed; sizes are width and height in px.

    ``moved`` Gaussians are moved by Adam and densified; ``counts`` are the Gaussians and the degrees of
    spherical harmonics of the steps that are timed.
    """

    goldens: Path
    scenes: tuple[str, ...] | None  # None: all
    views: int
    long_side_px: int
    points: int
    settings: TrainingSettings
    scored: tuple[Size, ...]
    candidates: int
    scored_gaussians: int
    moved: int
    counts: tuple[tuple[int, int], ...]
    timed: Size
    timed_steps: int
    extremes: tuple[int, Size]  # the most Gaussians, the largest image


FULL = Extent(
    goldens=Path(__file__).with_name("goldens.safetensors"),
    scenes=None,
    views=33,
    long_side_px=320,
    points=8_000,
    settings=TrainingSettings(
        iterations=500,
        sh_degree=1,
        sh_degree_interval=100,
        densification=Densification(first_iteration=100, last_iteration=400, interval=50),
    ),
    scored=((480, 270), (1920, 1080)),
    candidates=300,
    scored_gaussians=50_000,
    moved=2_000,
    counts=((100_000, 0), (1_000_000, 0), (3_000_000, 0), (1_000_000, 3)),
    timed=(1920, 1080),
    timed_steps=12,
    extremes=(10_000_000, (8_000, 6_000)),
)
DRY = Extent(
    goldens=Path(__file__).with_name("goldens-dry.safetensors"),
    scenes=("needles", "no gaussians"),
    views=3,
    long_side_px=24,
    points=8,
    settings=TrainingSettings(
        iterations=4,
        sh_degree=1,
        sh_degree_interval=1,
        densification=Densification(first_iteration=0, last_iteration=3, interval=1, gradient_threshold=1e-7),
    ),
    scored=((18, 14), (24, 18)),
    candidates=3,
    scored_gaussians=40,
    moved=40,
    counts=((10, 0), (20, 3)),
    timed=(18, 14),
    timed_steps=2,
    extremes=(40, (32, 18)),
)
"""Every step to its end in a minute of Triton's interpreter; its numbers mean nothing."""


@dataclass(frozen=True)
class Goldens:
    """The file of goldens: tensors by name, and facts."""

    tensors: dict[str, Tensor]
    facts: dict[str, Any]

    @staticmethod
    def read(extent: Extent) -> "Goldens":
        with safe_open(extent.goldens, "pt") as file:
            facts = json.loads(file.metadata()["facts"])
            return Goldens({name: file.get_tensor(name) for name in file.keys()}, facts)  # noqa: SIM118

    def part(self, prefix: str) -> dict[str, Tensor]:
        """The tensors under a prefix, by the rest of their name."""
        return {n.removeprefix(prefix): t for n, t in self.tensors.items() if n.startswith(prefix)}

    def scenes(self) -> list[str]:
        """The names of the hard scenes."""
        return sorted({key.split(".")[1] for key in self.tensors if key.startswith("scene.")})

    def views(self) -> list[TrainingView]:
        """The photographs of the training."""
        views = []
        for fact in self.facts["views"]:
            file = io.BytesIO(self.tensors[f"photograph.{fact['name']}"].numpy().tobytes())
            views.append(TrainingView(fact["name"], *camera_of(fact), np.asarray(Image.open(file))))
        return views


def camera_of(fact: dict[str, Any]) -> tuple[PinholeCamera, RigidTransform]:
    """A camera and its pose, as ``described`` has written them."""
    pose = RigidTransform(np.reshape(fact["rotation"], (3, 3)), np.array(fact["translation"]))
    return PinholeCamera(*fact["camera"]), pose


def described(camera: PinholeCamera, pose: RigidTransform) -> dict[str, Any]:
    """A camera and its pose as JSON."""
    return {
        "camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
        "rotation": pose.rotation.ravel().tolist(),
        "translation": pose.translation.tolist(),
    }


def gradients_of(
    rasterizer: Rasterizer, gaussians: Gaussians, hard: Any
) -> tuple[Rendering, dict[str, Tensor]]:
    """A rendering of a hard scene, and the gradients of a weighted sum of all that it shows."""
    rendering = rasterizer.render(gaussians, hard.camera, hard.camera_from_model)
    draw = torch.Generator().manual_seed(3)
    weights = torch.randn(*rendering.alpha.shape, 5, generator=draw) * hard.decided[..., None]
    values = torch.cat([rendering.color, rendering.alpha[..., None], rendering.depth[..., None]], dim=-1)
    (values * weights.to(values)).sum().backward()  # type: ignore[no-untyped-call]
    assert rendering.screen_means is not None
    found = {name: tensor.grad for name, tensor in gaussians.tensors().items()}
    # A backend may leave out the gradient of what it did not read.
    gradients = {
        name: torch.zeros_like(gaussians.tensors()[name]) if grad is None else grad
        for name, grad in found.items()
    }
    screen = rendering.screen_means.grad
    gradients["screen_means"] = rendering.color.new_zeros(len(gaussians), 2) if screen is None else screen
    return rendering, gradients


def squares_of(rasterizer: SquaringRasterizer, gaussians: Gaussians, hard: Any) -> dict[str, Tensor]:
    """The squared Jacobian of the rendering of a hard scene."""
    found = rasterizer.squared_jacobian(gaussians, hard.camera, hard.camera_from_model)
    return {name: getattr(found, name) for name in SQUARED}


class Scoring:
    """Candidates in the room, to be scored by their median frequencies."""

    def __init__(self, rasterizer: Rasterizer, extent: Extent, size: Size) -> None:
        self._rasterizer = rasterizer
        self._gaussians = scene(extent.scored_gaussians).to(rasterizer.device)
        self._candidates = candidates(extent.candidates, *size)

    def scores(self, *, one_by_one: bool = False) -> list[float]:
        """A score for each; NaN where there is none."""
        batches = [[one] for one in self._candidates] if one_by_one else [self._candidates]
        scorer = MedianFrequency()
        found = [one for batch in batches for one in scorer.score(self._gaussians, batch, self._rasterizer)]
        return [float("nan") if one.score is None else one.score for one in found]


def moved_by_adam(rasterizer: Rasterizer, extent: Extent) -> dict[str, Tensor]:
    """Gaussians after three steps of Adam along random gradients, a third of them unseen."""
    gaussians = with_harmonics(scene(extent.moved), 3).to(rasterizer.device).requires_grad_()
    guard = StepGuard(rasterizer.device) if rasterizer.steps_on_device else None
    adam = GaussianAdam(gaussians)
    draw = torch.Generator().manual_seed(1)
    radii_px = (torch.arange(extent.moved) % 3).float().to(rasterizer.device)
    for _ in range(3):
        for tensor in gaussians.tensors().values():
            tensor.grad = torch.randn(tensor.shape, generator=draw).to(tensor.device)
        adam.step(gaussians, dict.fromkeys(gaussians.tensors(), 1e-2), radii_px, 2, guard)
    return {name: tensor.detach().cpu() for name, tensor in gaussians.tensors().items()}


def densified(rasterizer: Rasterizer, extent: Extent) -> dict[str, Tensor]:
    """Gaussians after a densification by gradients that are given, to 1.4 times as many at most."""
    gaussians = scene(extent.moved).to(rasterizer.device)
    statistics = GradientStatistics(extent.moved, rasterizer.device)
    draw = torch.Generator().manual_seed(2)
    statistics.total = (4e-4 * torch.rand(extent.moved, generator=draw)).to(rasterizer.device)
    statistics.views = torch.ones(extent.moved, device=rasterizer.device)
    grown = densify(
        gaussians, GaussianAdam(gaussians), statistics, Densification(),
        extent=8.0, max_gaussians=extent.moved * 14 // 10, prune_large=True,
        generator=torch.Generator().manual_seed(3),
    )  # fmt: skip
    return {name: tensor.cpu() for name, tensor in grown.tensors().items()}


@dataclass(frozen=True)
class Training:
    """A training, and what it is worth at the photographs that were held out."""

    psnr_db: float
    gaussians: Gaussians


def trained(
    rasterizer: Rasterizer, extent: Extent, *, resumed: bool = True, cramped: bool = False
) -> Training:
    """Train on the photographs but every eighth, with densification.

    ``resumed``: saved and loaded halfway. ``cramped``: a device has room for one hit at first.
    """
    goldens, settings = Goldens.read(extent), extent.settings
    training, held_out = _split(goldens.views())
    points, colors = goldens.tensors["points"].numpy(), goldens.tensors["point_colors"].numpy()
    start = initialise_from_points(points.astype(np.float64), colors, settings.sh_degree)
    trainer = Trainer(training, start, settings, rasterizer)
    if cramped and trainer._guard is not None:
        trainer._guard.capacity = 1
    trainer.train(settings.iterations // 2, Monitor())
    if resumed:
        with tempfile.TemporaryDirectory() as folder:
            trainer.save(Path(folder) / "checkpoint")
            trainer = Trainer.resume(Path(folder) / "checkpoint", training, rasterizer)
    trainer.train(settings.iterations, Monitor())
    renders = [render_color(trainer.gaussians, view, rasterizer) for view in held_out]
    each = [psnr(render, view.image / 255) for render, view in zip(renders, held_out, strict=True)]
    return Training(float(np.mean(each)), trainer.gaussians)


def with_harmonics(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same with random harmonics of this degree."""
    draw = torch.Generator().manual_seed(4)
    gaussians.sh_rest = 0.1 * torch.randn(len(gaussians), (degree + 1) ** 2 - 1, 3, generator=draw)
    return gaussians


def _split(views: Sequence[TrainingView]) -> tuple[list[TrainingView], list[TrainingView]]:
    return [view for i, view in enumerate(views) if i % HELD_OUT_EVERY], list(views[::HELD_OUT_EVERY])
