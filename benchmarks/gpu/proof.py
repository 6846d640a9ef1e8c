"""The steps of the proof on a device (``prove.sh``), and what ``goldens.py`` computes of each on the CPU."""

import io
import json
import sys
import tempfile
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
from fvs_engine.splat.raster import Rasterizer, Rendering
from fvs_engine.splat.render import render_color
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.splat.views import TrainingView

FILE = Path(__file__).with_name("goldens.safetensors")
SCORED = ((480, 270), (1920, 1080))
CANDIDATES, SCORED_GAUSSIANS = 300, 50_000
STEPS, HALF, HELD_OUT_EVERY = 500, 250, 8
SETTINGS = TrainingSettings(
    iterations=STEPS,
    sh_degree=1,
    sh_degree_interval=100,
    densification=Densification(first_iteration=100, last_iteration=400, interval=50),
)


@dataclass(frozen=True)
class Goldens:
    """The file of goldens: tensors by name, and facts."""

    tensors: dict[str, Tensor]
    facts: dict[str, Any]

    @staticmethod
    def read() -> "Goldens":
        with safe_open(FILE, "pt") as file:
            facts = json.loads(file.metadata()["facts"])
            return Goldens({name: file.get_tensor(name) for name in file.keys()}, facts)  # noqa: SIM118

    def part(self, prefix: str) -> dict[str, Tensor]:
        """The tensors under a prefix, by the rest of their name."""
        return {n.removeprefix(prefix): t for n, t in self.tensors.items() if n.startswith(prefix)}

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
    # A backend may leave out the gradient of what it did not read.
    return rendering, {
        name: torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
        for name, tensor in gaussians.tensors().items()
    }


def candidate_scores(rasterizer: Rasterizer, size: tuple[int, int]) -> list[float]:
    """The median frequencies of 300 candidates in the room; NaN where there is none."""
    gaussians = scene(SCORED_GAUSSIANS).to(rasterizer.device)
    found = MedianFrequency().score(gaussians, candidates(CANDIDATES, *size), rasterizer)
    return [float("nan") if one.score is None else one.score for one in found]


def moved_by_adam(rasterizer: Rasterizer) -> dict[str, Tensor]:
    """2,000 Gaussians after three steps of Adam along random gradients, a third of them unseen."""
    gaussians = _with_harmonics(scene(2_000)).to(rasterizer.device).requires_grad_()
    guard = StepGuard(rasterizer.device) if rasterizer.steps_on_device else None
    adam = GaussianAdam(gaussians)
    draw = torch.Generator().manual_seed(1)
    radii_px = (torch.arange(2_000) % 3).float().to(rasterizer.device)
    for _ in range(3):
        for tensor in gaussians.tensors().values():
            tensor.grad = torch.randn(tensor.shape, generator=draw).to(tensor.device)
        adam.step(gaussians, dict.fromkeys(gaussians.tensors(), 1e-2), radii_px, 2, guard)
    return {name: tensor.detach().cpu() for name, tensor in gaussians.tensors().items()}


def densified(rasterizer: Rasterizer) -> dict[str, Tensor]:
    """2,000 Gaussians after a densification by gradients that are given."""
    gaussians = scene(2_000).to(rasterizer.device)
    statistics = GradientStatistics(2_000, rasterizer.device)
    draw = torch.Generator().manual_seed(2)
    statistics.total = (4e-4 * torch.rand(2_000, generator=draw)).to(rasterizer.device)
    statistics.views = torch.ones(2_000, device=rasterizer.device)
    grown = densify(
        gaussians, GaussianAdam(gaussians), statistics, Densification(),
        extent=8.0, max_gaussians=2_800, prune_large=True, generator=torch.Generator().manual_seed(3),
    )  # fmt: skip
    return {name: tensor.cpu() for name, tensor in grown.tensors().items()}


@dataclass(frozen=True)
class Training:
    """A training of 500 steps that was saved and resumed after half of them."""

    psnr_db: float
    gaussians: Gaussians


def trained(rasterizer: Rasterizer, goldens: Goldens) -> Training:
    """Train on the photographs but every eighth, with densification and a resume; the PSNR at the others."""
    views = goldens.views()
    held_out = views[::HELD_OUT_EVERY]
    training = [view for view in views if view not in held_out]
    points, colors = goldens.tensors["points"].numpy(), goldens.tensors["point_colors"].numpy()
    start = initialise_from_points(points.astype(np.float64), colors, SETTINGS.sh_degree)
    trainer = Trainer(training, start, SETTINGS, rasterizer)
    trainer.train(HALF, Monitor())
    with tempfile.TemporaryDirectory() as folder:
        trainer.save(Path(folder) / "checkpoint")
        trainer = Trainer.resume(Path(folder) / "checkpoint", training, rasterizer)
    trainer.train(STEPS, Monitor())
    renders = [render_color(trainer.gaussians, view, rasterizer) for view in held_out]
    each = [psnr(render, view.image / 255) for render, view in zip(renders, held_out, strict=True)]
    return Training(float(np.mean(each)), trainer.gaussians)


def _with_harmonics(gaussians: Gaussians) -> Gaussians:
    draw = torch.Generator().manual_seed(4)
    gaussians.sh_rest = torch.randn(len(gaussians), 15, 3, generator=draw)
    return gaussians
