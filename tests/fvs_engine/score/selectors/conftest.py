"""A small scene, cameras around it, and contexts to choose in."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.scene.dataset import Dataset, read_dataset
from fvs_engine.score.selectors.interface import SelectionContext, select
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(32, 24, 28.0, 28.0, 16.0, 12.0)


@pytest.fixture(scope="session")
def room(room_dir: Path) -> Dataset:
    """Twenty-four views with known poses."""
    return read_dataset(room_dir / "images", colmap=room_dir / "sparse")


@pytest.fixture(scope="session")
def reference():
    return create_rasterizer("reference")


@pytest.fixture
def ball() -> Gaussians:
    """Opaque Gaussians on a sphere of radius 1: from no side is the other one seen."""
    generator = torch.Generator().manual_seed(0)
    count = 500
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    return Gaussians(
        means=directions,
        log_scales=torch.full((count, 3), math.log(0.12)),
        quaternions_wxyz=torch.randn(count, 4, generator=generator),
        opacity_logits=torch.full((count,), 3.0),
        sh_dc=torch.randn(count, 3, generator=generator),
        sh_rest=torch.zeros(count, 0, 3),
    )


@pytest.fixture
def view_at():
    """Make a view: ``view_at(id, centre, target=(0, 0, 0))``."""

    def make(name, centre, target=(0.0, 0.0, 0.0), camera=CAMERA) -> PinholeView:
        return PinholeView(name, camera, look_at(centre, target, (0.0, 0.0, 1.0)).inverse())

    return make


@pytest.fixture
def ring(view_at):
    """Views around the ball, by angle in degrees: ``ring(0, 90)``."""

    def make(*angles_deg) -> tuple[PinholeView, ...]:
        angles = np.radians(angles_deg)
        return tuple(
            view_at(f"{degrees:03d}", (3 * np.cos(a), 3 * np.sin(a), 0.3))
            for degrees, a in zip(angles_deg, angles, strict=True)
        )

    return make


@pytest.fixture(scope="session")
def cpu():
    return create_rasterizer("cpu")


@pytest.fixture
def context(ball, cpu):
    """Make a context: ``context(visited, candidates, budget=…)``; captured in the order given."""

    def make(visited, candidates, *, gaussians=ball, rasterizer=cpu, **changes) -> SelectionContext:
        order = {view.name: place for place, view in enumerate([*visited, *candidates])}
        values = {"order": order, "budget": 20, "seed": 0, "step": 0, "sh_degree": None, **changes}
        return SelectionContext(
            gaussians=gaussians,
            rasterizer=rasterizer,
            visited=tuple(visited),
            candidates=tuple(candidates),
            **values,
        )

    return make


@pytest.fixture
def chosen_in_turn():
    """The ids of ``count`` views, each chosen when those before it were visited."""

    def walk(context, selector, count) -> list[str]:
        chosen = []
        for _ in range(count):
            chosen.append(select(context, selector, {}).chosen)
            left = tuple(view for view in context.candidates if view.name != chosen[-1])
            (there,) = set(context.candidates) - set(left)
            visited = (*context.visited, there)
            context = replace(context, visited=visited, candidates=left, step=context.step + 1)
        return chosen

    return walk
