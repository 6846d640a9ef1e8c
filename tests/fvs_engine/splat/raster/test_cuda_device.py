"""Where the backends of GPUs cannot run, a sentence says why."""

import sys

import pytest
import torch

from fvs_engine.errors import BackendUnavailableError
from fvs_engine.splat.raster import create_rasterizer

BACKENDS = ["triton", "gsplat"]


@pytest.fixture(autouse=True)
def _a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRITON_INTERPRET", raising=False)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)


def refused(backend: str) -> BackendUnavailableError:
    with pytest.raises(BackendUnavailableError) as raised:
        create_rasterizer(backend)
    return raised.value


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_device_or_an_old_driver(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    error = refused(backend)
    assert "need a CUDA device" in error.message
    assert "a driver too old" in error.hint


@pytest.mark.parametrize("backend", BACKENDS)
def test_devices_of_other_makers(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.version, "hip", "6.4")
    assert "never tried on ROCm" in refused(backend).message


def test_no_triton(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "triton", None)
    assert "need the package triton" in refused("triton").message


def test_no_compiler_for_triton(monkeypatch: pytest.MonkeyPatch) -> None:
    triton = pytest.importorskip("triton")

    def active(_: object) -> None:
        raise RuntimeError("Failed to find C compiler.")

    monkeypatch.setattr(type(triton.runtime.driver), "active", property(active))
    error = refused("triton")
    assert "Triton cannot use the CUDA device: Failed to find C compiler" in error.message
    assert "python3-dev" in error.hint
