"""Scenes that rasterisers must agree on, and gsplat without its kernels."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
import torch
from raster_scenes import SCENES, Scene, build_scene, random_splats

from fvs_engine.splat.conventions import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return build_scene(request.param)


@pytest.fixture
def make_gaussians() -> Callable[..., Gaussians]:
    def make(count: int, seed: int = 0, sh_degree: int = 3) -> Gaussians:
        return random_splats(count, torch.Generator().manual_seed(seed), sh_degree)

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
    monkeypatch.delitem(sys.modules, "fvs_engine.splat.raster.gsplat", raising=False)
    installed = _forget_gsplat()
    yield package
    _forget_gsplat()
    sys.modules.update(installed)


def _forget_gsplat() -> dict[str, ModuleType]:
    return {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] == "gsplat"}


@pytest.fixture
def gsplat_in_torch(monkeypatch: pytest.MonkeyPatch) -> Rasterizer:
    """The ``gsplat`` backend on the CPU, over gsplat's own torch functions, in any dtype.

    Only the blending is ours. The module of the compiled kernels is one without any.
    """
    import gsplat
    import gsplat.rendering

    kernels = ModuleType("gsplat.csrc")
    monkeypatch.setitem(sys.modules, kernels.__name__, kernels)
    monkeypatch.setattr(gsplat, "csrc", kernels, raising=False)
    monkeypatch.delitem(sys.modules, "fvs_engine.splat.raster.gsplat", raising=False)
    stand_ins = {
        "fully_fused_projection": _project,
        "isect_tiles": _sort,
        "isect_offset_encode": lambda _, images, width, height: torch.zeros(images, height, width),
        "rasterize_to_pixels": _blend,
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(gsplat.rendering, name, stand_in)
    adapter = importlib.import_module("fvs_engine.splat.raster.gsplat")
    monkeypatch.delitem(sys.modules, adapter.__name__)  # others import it over gsplat's own kernels
    return adapter.GsplatRasterizer(torch.device("cpu"))
