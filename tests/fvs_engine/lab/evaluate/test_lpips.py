"""The packages and weights are not among the test's own: stand-ins show what is done when they are there."""

import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

from fvs_engine.lab.evaluate.lpips import BACKBONE_FILE, find_lpips

CPU = torch.device("cpu")


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Make exactly these packages importable, of those that LPIPS needs."""

    def put(**modules: ModuleType) -> None:
        real = importlib.util.find_spec

        def find(name: str, package: str | None = None) -> importlib.machinery.ModuleSpec | None:
            if name in ("lpips", "torchmetrics", "torchvision"):
                return importlib.machinery.ModuleSpec(name, None) if name in modules else None
            return real(name, package)

        monkeypatch.setattr(importlib.util, "find_spec", find)
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, name, module)

    return put


def fake_lpips() -> ModuleType:
    class MeanDifference(torch.nn.Module):
        def __init__(self, net: str, verbose: bool) -> None:
            super().__init__()
            assert (net, verbose) == ("vgg", False)

        def forward(self, a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
            assert a.shape == b.shape == (1, 3, 8, 9)
            return (a - b).abs().mean(dim=(1, 2, 3), keepdim=True)

    module = ModuleType("lpips")
    module.LPIPS = MeanDifference  # type: ignore[attr-defined]
    return module


def test_without_a_package_the_reason_is_given(install: Callable[..., None]) -> None:
    install()
    status = find_lpips(CPU)
    assert status.compute is None
    assert "lpips" in status.reason
    assert "torchmetrics" in status.reason


def test_torchvision_is_needed_too(install: Callable[..., None]) -> None:
    install(torchmetrics=ModuleType("torchmetrics"))
    assert "torchvision" in find_lpips(CPU).reason


def test_without_weights_nothing_is_downloaded(
    install: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def no_package_may_be_asked(**_: object) -> None:
        raise AssertionError("it would download its weights")

    module = ModuleType("lpips")
    module.LPIPS = no_package_may_be_asked  # type: ignore[attr-defined]
    install(lpips=module, torchvision=ModuleType("torchvision"))
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    status = find_lpips(CPU)
    assert status.compute is None
    assert str(tmp_path) in status.reason


def test_a_package_that_does_not_work_is_named(
    install: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def made_for_another_torch(**_: object) -> None:
        raise RuntimeError("operator torchvision::nms does not exist")

    module = ModuleType("lpips")
    module.LPIPS = made_for_another_torch  # type: ignore[attr-defined]
    install(lpips=module, torchvision=ModuleType("torchvision"))
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / BACKBONE_FILE).touch()
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    status = find_lpips(CPU)
    assert status.compute is None
    assert "torchvision::nms" in status.reason


def test_with_package_and_weights_images_are_compared_in_the_network_s_range(
    install: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install(lpips=fake_lpips(), torchvision=ModuleType("torchvision"))
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / BACKBONE_FILE).touch()
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    status = find_lpips(CPU)
    assert status.compute is not None
    black, grey = np.zeros((8, 9, 3)), np.full((8, 9, 3), 0.25)
    assert status.compute(black, black) == 0.0
    assert status.compute(black, grey) == pytest.approx(0.5)  # [0, 1] becomes [−1, 1]
