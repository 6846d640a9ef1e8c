"""GPU slots limit how many jobs train at once; a slot is released when its holder ends."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest
import torch
from fvs_service.host.runner import gpu_slots
from fvs_service.host.runner.gpu_slots import gpu_slot

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor

GPU = torch.device("cuda", 0)
_WITHIN_S = 30.0


@pytest.fixture(autouse=True)
def _a_gpu(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(gpu_slots, "_name_of", lambda _device: "GPU-1")
    monkeypatch.setattr(gpu_slots, "private_folder", lambda _name: tmp_path)
    monkeypatch.setattr(gpu_slots, "_POLL_S", 0.01)


def _training(slots: int, training: threading.Semaphore, end: threading.Event) -> threading.Thread:
    def train() -> None:
        with gpu_slot(GPU, slots, Monitor()):
            training.release()
            assert end.wait(_WITHIN_S)

    thread = threading.Thread(target=train)
    thread.start()
    return thread


@pytest.mark.parametrize("slots", [1, 2])
def test_so_many_train_at_once(slots: int) -> None:
    training, end = threading.Semaphore(0), threading.Event()
    threads = [_training(slots, training, end) for _ in range(slots + 1)]
    for _ in range(slots):
        assert training.acquire(timeout=_WITHIN_S)
    assert not training.acquire(timeout=0.2)
    end.set()
    assert training.acquire(timeout=_WITHIN_S)
    for thread in threads:
        thread.join()


def test_who_waits_can_be_stopped() -> None:
    training, end, monitor = threading.Semaphore(0), threading.Event(), Monitor()
    thread = _training(1, training, end)
    assert training.acquire(timeout=_WITHIN_S)
    threading.Timer(0.1, monitor.cancel).start()
    with pytest.raises(Cancelled), gpu_slot(GPU, 1, monitor):
        raise AssertionError
    end.set()
    thread.join()


def test_a_process_that_dies_frees_its_slot(tmp_path: Path) -> None:
    code = (
        "import fcntl, pathlib, sys, time\n"
        "file = pathlib.Path(sys.argv[1]).open('ab')\n"
        "fcntl.flock(file, fcntl.LOCK_EX); print('held', flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "GPU-1-0")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        assert gpu_slots._free_slot(GPU, 1) is None
        holder.kill()
    with gpu_slot(GPU, 1, Monitor()):
        pass


def test_a_cpu_has_no_slots(tmp_path: Path) -> None:
    with gpu_slot(torch.device("cpu"), 1, Monitor()), gpu_slot(torch.device("cpu"), 1, Monitor()):
        assert not list(tmp_path.iterdir())
