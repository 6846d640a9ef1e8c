from types import SimpleNamespace
from typing import Any, cast

from fvs_engine.splat.device_memory import model_bytes, training_bytes, view_bytes
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import PRESETS


def _views(count: int, width: int, height: int) -> list[Any]:
    return [SimpleNamespace(camera=SimpleNamespace(width=width, height=height))] * count


def test_a_training_needs_memory_for_gaussians_and_photographs() -> None:
    fine, coarse = PRESETS["fine"], PRESETS["coarse"]
    base = training_bytes(fine, _views(100, 1600, 1200))
    assert 4e9 < base < 8e9
    assert training_bytes(coarse, _views(100, 640, 480)) < 1.5e9
    assert (
        training_bytes(fine.model_copy(update={"max_gaussians": 2_000_000}), _views(100, 1600, 1200)) > base
    )
    assert training_bytes(fine, _views(101, 1600, 1200)) == base + 7 * 1600 * 1200
    assert training_bytes(fine, []) < base


def test_a_view_needs_memory_for_gaussians_and_pixels(make_gaussians: Any) -> None:
    gaussians = cast(Gaussians, make_gaussians(1000, 3))
    assert model_bytes(gaussians) == sum(tensor.nbytes for tensor in gaussians.tensors().values())
    assert view_bytes(gaussians, 480, 270) > view_bytes(make_gaussians(10, 3), 480, 270)
    assert view_bytes(gaussians, 480, 270) > 480 * 270 * 16
