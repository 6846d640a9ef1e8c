"""Where the backends of GPUs cannot run, a sentence says why."""

import sys
import threading
import time
from typing import Any

import pytest
import torch

from fvs_engine.errors import BackendUnavailableError
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.raster.cuda_device import load_kernels_one_at_a_time

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


def test_a_kernel_is_launched_only_when_it_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = pytest.importorskip("triton.compiler")
    monkeypatch.setattr(compiler.CompiledKernel, "run", compiler.CompiledKernel.run)
    load_kernels_one_at_a_time()
    loading = threading.Event()

    class Kernel(compiler.CompiledKernel):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            self.function: Any = None
            self._run: Any = None

        def _init_handles(self) -> None:
            if self.function is None:
                self._run = print
                loading.set()
                time.sleep(0.05)
                self.function = 1

    kernel = Kernel()
    other = threading.Thread(target=lambda: kernel.run)
    other.start()
    loading.wait()
    assert (kernel.run, kernel.function) == (print, 1)
    other.join()
