"""Scenes that rasterisers must agree on, and the pixels where float32 cannot decide."""

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.raster.reference_projection import project

CAMERA = PinholeCamera(75, 54, 60.0, 62.0, 36.0, 28.0)  # no multiple of a tile, principal point off centre


def _gaussians(count: int, generator: torch.Generator, sh_degree: int = 3) -> Gaussians:
    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    coefficients = (sh_degree + 1) ** 2 - 1
    return Gaussians(
        means=normal(count, 3) * torch.tensor([1.0, 0.8, 0.7]) + torch.tensor([0.0, 0.0, 4.0]),
        log_scales=normal(count, 3) * 0.6 - 2.5,
        quaternions_wxyz=normal(count, 4),
        opacity_logits=normal(count) * 1.5,
        sh_dc=normal(count, 3),
        sh_rest=normal(count, coefficients, 3) * 0.2,
    )


def _scene(name: str) -> Gaussians:
    generator = torch.Generator().manual_seed(7)
    g = _gaussians(240, generator)
    if name == "behind":
        g.means[:, 2] -= 4.0
    elif name == "edge":
        side = torch.arange(240) % 4
        z = g.means[:, 2]
        g.means[:, 0] = torch.where(side == 0, -0.62 * z, torch.where(side == 1, 0.66 * z, g.means[:, 0]))
        g.means[:, 1] = torch.where(side == 2, -0.46 * z, torch.where(side == 3, 0.43 * z, g.means[:, 1]))
    elif name == "huge":
        g.log_scales += 3.5
        g.opacity_logits -= 2.0
    elif name == "needles":
        g.log_scales[:, 0] += 2.5
        g.log_scales[:, 1:] -= 4.0
    elif name == "transparent":
        g.opacity_logits = torch.linspace(-9.0, -4.0, 240)
    elif name == "opaque":
        g.opacity_logits = torch.linspace(4.0, 12.0, 240)
        g.log_scales += 1.0
    elif name == "one pixel":
        g = _gaussians(3000, generator, sh_degree=0)
        g.means[:, :2] = 0.002 * g.means[:, :2]
        g.log_scales -= 2.0
        g.opacity_logits -= 5.0
    elif name == "nothing in view":
        g.means[:, 2] = -g.means[:, 2].abs()
    elif name == "no gaussians":
        g = Gaussians(**{key: tensor[:0] for key, tensor in g.tensors().items()})
    return g


SCENES = [
    "random", "behind", "edge", "huge", "needles", "transparent", "opaque", "one pixel", "nothing in view",
    "no gaussians",
]  # fmt: skip


def _undecided(g: Gaussians, camera: PinholeCamera, camera_from_model: RigidTransform) -> Tensor:
    """Pixels [H, W] where an alpha or a transmittance is so near its threshold that rounding decides."""
    splats = project(g, camera, camera_from_model, 0)
    order = torch.argsort(splats.depths, stable=True)
    order = order[splats.visible[order]]
    xs = torch.arange(camera.width, dtype=torch.float64) + 0.5
    dx = xs[:, None] - splats.centers[order, 0]
    a, k, b = splats.factors[order].unbind(-1)
    rows = []
    for y in range(camera.height):
        dy = y + 0.5 - splats.centers[order, 1]
        exponent = (a * (dx - k * dy)) ** 2 + (b * dy) ** 2
        raw = splats.opacities[order] * torch.exp(-exponent)
        alphas = torch.where(raw >= ALPHA_MIN, raw.clamp_max(ALPHA_MAX), 0)
        after = torch.cumprod(1 - alphas, dim=-1)
        near_alpha = ((raw / ALPHA_MIN - 1).abs() < 1e-4) | ((raw / ALPHA_MAX - 1).abs() < 1e-5)
        near_end = (after / TRANSMITTANCE_MIN - 1).abs() < 1e-3
        rows.append((near_alpha | near_end).any(-1))
    return torch.stack(rows)


@dataclass
class Scene:
    """Gaussians, where they are seen from, and which pixels two correct rasterisers may differ in."""

    gaussians: Gaussians
    camera: PinholeCamera
    camera_from_model: RigidTransform
    decided: Tensor

    def copy(self, dtype: torch.dtype = torch.float32, device: str = "cpu") -> Gaussians:
        """Leaves that collect their own gradients."""
        tensors = self.gaussians.tensors()
        return Gaussians(
            **{key: t.detach().clone().to(device, dtype).requires_grad_() for key, t in tensors.items()}
        )


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return _build(request.param)


@cache
def _build(name: str) -> Scene:
    gaussians = _scene(name)
    angle = torch.tensor(0.1, dtype=torch.float64)
    rotation = torch.tensor(
        [[angle.cos(), 0, angle.sin()], [0, 1, 0], [-angle.sin(), 0, angle.cos()]], dtype=torch.float64
    )
    pose = RigidTransform(rotation.numpy(), torch.tensor([-0.3, 0.1, 0.2], dtype=torch.float64).numpy())
    exact = Gaussians(**{key: tensor.double() for key, tensor in gaussians.tensors().items()})
    decided = ~_undecided(exact, CAMERA, pose)
    assert decided.float().mean() > 0.9, "a scene with so few comparable pixels tests nothing"
    return Scene(gaussians, CAMERA, pose, decided)


@pytest.fixture
def make_gaussians() -> Callable[..., Gaussians]:
    def make(count: int, seed: int = 0, sh_degree: int = 3) -> Gaussians:
        return _gaussians(count, torch.Generator().manual_seed(seed), sh_degree)

    return make


def _project(means, covars, quats, scales, viewmats, Ks, width, height, **options):
    """gsplat's ``fully_fused_projection`` by gsplat's own torch functions."""
    from gsplat.cuda import _torch_impl as plain

    assert covars is None
    for name in ("packed", "sparse_grad", "calc_compensations"):
        assert not options.pop(name), name
    assert options.pop("radius_clip") == 0
    del options["opacities"]  # only tightens the boxes
    covars, _ = plain._quat_scale_to_covar_preci(quats, scales, compute_preci=False)
    return plain._fully_fused_projection(means, covars, viewmats, Ks, width, height, **options)


def _sort(_means2d, radii, depths, *_, **__):
    """gsplat's ``isect_tiles`` with the image as the one tile: what is not culled, front to back."""
    order = torch.argsort(depths[0], stable=True)
    return None, None, order[(radii[0, order] > 0).all(-1)]


def _blend(
    means2d, conics, colors, opacities, width, height, _size, _offsets, order, *, backgrounds, packed, absgrad
):
    """gsplat's ``rasterize_to_pixels`` with the image as the one tile."""
    assert backgrounds is None
    assert not packed
    assert not absgrad
    (centers,), (conics,), (colors,), (opacities,) = means2d, conics, colors, opacities
    rows, columns = torch.arange(height) + 0.5, (torch.arange(width) + 0.5).to(centers)
    a, b, c = conics[order].unbind(-1)
    images = []
    for row in rows:
        dx, dy = columns[:, None] - centers[order, 0], row - centers[order, 1]
        exponent = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alphas = (opacities[order] * torch.exp(-exponent)).clamp_max(ALPHA_MAX)
        alphas = torch.where((exponent >= 0) & (alphas >= ALPHA_MIN), alphas, 0)
        after = torch.cumprod(1 - alphas, dim=-1)
        before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=-1)
        weights = torch.where(after > TRANSMITTANCE_MIN, alphas * before, 0)
        images.append(torch.cat([weights @ colors[order], weights.sum(-1, keepdim=True)], dim=-1))
    image = torch.stack(images)[None]
    return image[..., :-1], image[..., -1:]


@pytest.fixture
def fake_gsplat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A machine with a device, and the empty folder from which the test imports its own gsplat."""
    package = tmp_path / "gsplat"
    package.mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.delitem(sys.modules, "fvs_engine.splat.raster.cuda", raising=False)
    installed = _forget_gsplat()
    yield package
    _forget_gsplat()
    sys.modules.update(installed)


def _forget_gsplat() -> dict[str, ModuleType]:
    return {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] == "gsplat"}


@pytest.fixture
def gsplat_in_torch(monkeypatch: pytest.MonkeyPatch) -> Rasterizer:
    """The ``cuda`` backend on the CPU: gsplat's ``rasterization`` over its own torch functions, in any dtype.

    Only the blending is ours. Nothing is compiled: the module that would do it is replaced before its import.
    """
    import gsplat.cuda
    import gsplat.rendering
    from gsplat.cuda import _torch_impl as plain

    kernels = ModuleType("gsplat.cuda._backend")
    kernels._C = object()
    monkeypatch.setitem(sys.modules, kernels.__name__, kernels)
    monkeypatch.setattr(gsplat.cuda, "_backend", kernels, raising=False)
    monkeypatch.delitem(sys.modules, "fvs_engine.splat.raster.cuda", raising=False)
    stand_ins = {
        "fully_fused_projection": _project,
        "spherical_harmonics": lambda *arguments, masks: plain._spherical_harmonics(*arguments),  # noqa: ARG005
        "isect_tiles": _sort,
        "isect_offset_encode": lambda _, images, width, height: torch.zeros(images, height, width),
        "rasterize_to_pixels": _blend,
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(gsplat.rendering, name, stand_in)
    adapter = importlib.import_module("fvs_engine.splat.raster.cuda")
    monkeypatch.delitem(sys.modules, adapter.__name__)  # others import it over gsplat's own kernels
    rasterizer = adapter.CudaRasterizer()
    assert rasterizer.device.type == "cuda"
    rasterizer.device = torch.device("cpu")
    return rasterizer
