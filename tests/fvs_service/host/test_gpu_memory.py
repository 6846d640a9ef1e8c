"""Trainings and rankings of all runners share a GPU's memory; what a process held is free when it ends."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch
from fvs_service.host.runner import gpu_memory
from fvs_service.host.runner.gpu_memory import GpuMemory

from fvs_engine.errors import Cancelled, DeviceMemoryError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.device_memory import model_bytes, view_bytes
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import View

GPU = torch.device("cuda", 0)
GIGABYTE = 10**9
TOTAL_BYTES = 40 * GIGABYTE
WITHIN_S = 30.0
RASTERIZER = cast(Rasterizer, SimpleNamespace(device=GPU, batch_bytes=4 * GIGABYTE))
VIEWS = [View("a", PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0), RigidTransform(np.eye(3), np.zeros(3)))]


@pytest.fixture(autouse=True)
def _a_gpu(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(gpu_memory, "_memory_of", lambda _device: (TOTAL_BYTES, "GPU-1"))
    monkeypatch.setattr(gpu_memory, "private_folder", lambda _name: tmp_path)
    monkeypatch.setattr(gpu_memory, "_POLL_S", 0.01)


@pytest.fixture
def gaussians() -> Gaussians:
    return initialise_from_points(
        np.random.default_rng(0).normal(size=(50, 3)), np.zeros((50, 3), np.uint8), 0
    )


@pytest.fixture
def runner() -> Iterator[Callable[[], GpuMemory]]:
    """Starts a runner."""
    with ExitStack() as ended:

        def start() -> GpuMemory:
            memory = GpuMemory(GPU)
            assert memory._own is not None
            ended.enter_context(memory._own[0])
            return memory

        yield start


class Impatient(Monitor):
    """Cancels who has to wait."""

    def check(self) -> None:
        raise Cancelled("It waits.")


@contextmanager
def _training(memory: GpuMemory, gigabytes: float) -> Iterator[None]:
    with memory.for_training(round(gigabytes * GIGABYTE), Impatient()):
        yield


def _must_wait(memory: GpuMemory, gigabytes: float) -> None:
    with pytest.raises(Cancelled, match="It waits"), _training(memory, gigabytes):
        raise AssertionError


def test_trainings_of_all_runners_run_at_once_while_they_fit(runner: Callable[[], GpuMemory]) -> None:
    first, second = runner(), runner()
    with _training(first, 14), _training(second, 14):
        _must_wait(second, 1)
    with _training(second, 28):
        _must_wait(first, 1)


def test_a_training_that_is_too_large_for_the_device_runs_while_no_other_does(
    runner: Callable[[], GpuMemory],
) -> None:
    memory = runner()
    with _training(memory, 100):
        _must_wait(memory, 1)
    with _training(memory, 1):
        _must_wait(memory, 100)


def test_who_waits_gets_the_memory_that_another_leaves(runner: Callable[[], GpuMemory]) -> None:
    memory, ended, trained = runner(), threading.Event(), threading.Event()

    def train() -> None:
        with memory.for_training(30 * GIGABYTE, Monitor()):
            trained.set()

    thread = threading.Thread(target=train)
    with _training(memory, 10):
        thread.start()
        assert not trained.wait(0.1)
        ended.set()
    assert trained.wait(WITHIN_S)
    thread.join()


def _model(gaussians: Gaussians) -> SceneModel:
    return SceneModel(gaussians=gaussians, sh_degree=0, iterations=1)


def _granted(memory: GpuMemory, gaussians: Gaussians, monitor: Monitor | None = None) -> int:
    with memory.for_renders(_model(gaussians), VIEWS, RASTERIZER, monitor or Impatient()) as rasterizer:
        return rasterizer.batch_bytes


def test_a_ranking_beside_trainings_renders_fewer_views_at_once(
    gaussians: Gaussians, runner: Callable[[], GpuMemory]
) -> None:
    """It has what is left of 38 GB, and never waits for a training: one view is rendered all the same."""
    memory, one_view = runner(), view_bytes(gaussians, 64, 48)
    assert _granted(memory, gaussians) == 4 * GIGABYTE
    with _training(memory, 29):
        assert _granted(memory, gaussians) == 4 * GIGABYTE
        others = [runner() for _ in range(6)]
        assert _granted(memory, gaussians) == 2 * GIGABYTE - model_bytes(gaussians)
        others += [runner() for _ in range(4)]
        assert _granted(memory, gaussians) == one_view
    assert RASTERIZER.batch_bytes == 4 * GIGABYTE
    assert others


def test_rankings_wait_for_each_other(gaussians: Gaussians, runner: Callable[[], GpuMemory]) -> None:
    memories = [runner() for _ in range(38)]
    with memories[0].for_renders(_model(gaussians), VIEWS, RASTERIZER, Monitor()), pytest.raises(Cancelled):
        _granted(memories[1], gaussians)
    _granted(memories[1], gaussians)


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB."),
        RuntimeError("CUDA error: out of memory\nCompile with `TORCH_USE_CUDA_DSA`"),
        RuntimeError("Triton Error [CUDA]: out of memory"),
        RuntimeError("cuFFT error: CUFFT_ALLOC_FAILED"),
    ],
)
def test_a_device_without_memory_is_an_error_that_says_what_to_lower(
    error: Exception, runner: Callable[[], GpuMemory]
) -> None:
    """Its tensors and its reservation are free, though the error is kept."""
    memory = runner()
    freed = []

    class Large:
        def __del__(self) -> None:
            freed.append(True)

    def train() -> None:
        large = Large()
        raise error if large else AssertionError

    with pytest.raises(DeviceMemoryError, match="run out") as raised, _training(memory, 30):
        train()
    assert "fewer Gaussians" in raised.value.hint
    assert freed
    with _training(memory, 29):
        pass


def test_other_errors_of_a_training_stay_as_they_are(runner: Callable[[], GpuMemory]) -> None:
    memory = runner()
    with pytest.raises(RuntimeError, match="an illegal memory access"), _training(memory, 1):
        raise RuntimeError("CUDA error: an illegal memory access was encountered")
    assert len(memory._reservations()) == 1


def test_a_process_that_dies_frees_its_memory(tmp_path: Path, runner: Callable[[], GpuMemory]) -> None:
    memory = runner()
    path = tmp_path / "GPU-1" / f"training-{29 * GIGABYTE}-0123456789abcdef"
    code = (
        "import fcntl, pathlib, sys, time\n"
        "file = pathlib.Path(sys.argv[1]).open('ab')\n"
        "fcntl.flock(file, fcntl.LOCK_EX); print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        _must_wait(memory, 1)
        holder.kill()
    with _training(memory, 29):
        assert not path.exists()


def test_on_a_cpu_nothing_is_reserved(tmp_path: Path, gaussians: Gaussians) -> None:
    memory = GpuMemory(torch.device("cpu"))
    with _training(memory, 100), _training(memory, 100):
        with memory.for_renders(_model(gaussians), VIEWS, RASTERIZER, Impatient()) as rasterizer:
            assert rasterizer is RASTERIZER
        assert not list(tmp_path.iterdir())
