"""The slots of a GPU: the number of jobs of a machine's user that train on it at once, of all workers.

Others register images meanwhile, on the CPU, or wait. A slot is a locked file, so it is free again when the
process that holds it ends, however that ends.
"""

import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

import torch

from fvs_engine.files.private_folder import private_folder
from fvs_engine.monitor import Monitor
from fvs_service.settings import GPU_SLOTS

_POLL_S = 0.2


@contextmanager
def gpu_slot(device: torch.device, slots: int, monitor: Monitor) -> Iterator[None]:
    """Hold one of the ``slots`` of a GPU around training; a CPU has no slots.

    Raises ``Cancelled`` while it waits, ``StorageError`` when the folder of the files cannot be used.
    """
    if device.type != "cuda":
        yield
        return
    held = _free_slot(device, slots)
    while held is None:
        monitor.check()
        time.sleep(_POLL_S)
        held = _free_slot(device, slots)
    with held:
        yield


def _free_slot(device: torch.device, slots: int) -> IO[bytes] | None:
    """A slot's file, locked; None when all slots are taken."""
    folder = private_folder(GPU_SLOTS)
    for number in range(slots):
        path = folder / f"{_name_of(device)}-{number}"
        file = path.open("ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
        else:
            return file
    return None


def _name_of(device: torch.device) -> str:
    """The GPU's own name, the same in all processes: its number is not (CUDA_VISIBLE_DEVICES)."""
    return str(torch.cuda.get_device_properties(device).uuid)
