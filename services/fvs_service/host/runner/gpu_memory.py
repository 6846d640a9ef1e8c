"""The memory of a GPU, divided among the trainings and rankings of all runners of a machine's user.

A reservation is a locked file whose name has its bytes, so it ends with the process that holds it, however
that ends. Trainings wait for each other and leave room for rankings, which do not wait for a training: they
render fewer views at once.
"""

import contextlib
import copy
import fcntl
import secrets
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Literal

import torch

from fvs_engine.files.private_folder import private_folder
from fvs_engine.files.storage import storage_errors
from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.device_memory import model_bytes, view_bytes
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_service.settings import GPU_MEMORY

_RUNNER_BYTES = 1_000_000_000
"""Of every runner: CUDA's context, code of kernels, workspaces of libraries, and models that wait."""
_Kind = Literal["runner", "training", "ranking"]
_SHARES: dict[_Kind, float] = {"runner": 1.0, "training": 0.75, "ranking": 0.95}
"""The share of the device's memory up to which reservations of this kind are made."""
_POLL_S = 0.2


class GpuMemory:
    """A device's memory as one runner sees it, which counts from then on. On a CPU nothing is reserved."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        if device.type == "cuda":
            self._total_bytes, name = _memory_of(device)
            self._folder = private_folder(GPU_MEMORY) / name
            with storage_errors(self._folder):
                self._folder.mkdir(exist_ok=True)
            self._own = self._reserve("runner", _RUNNER_BYTES, _RUNNER_BYTES)

    @contextmanager
    def for_training(self, need_bytes: int, monitor: Monitor) -> Iterator[None]:
        """Hold the memory of a training; one that needs more than there is runs while no other does.

        Raises ``Cancelled`` while it waits, ``DeviceMemoryError`` when the device has too little after all.
        """
        if self._device.type == "cpu":
            yield
            return
        need_bytes = min(need_bytes, self._limit_bytes("training"))
        with self._held("training", need_bytes, need_bytes, monitor):
            yield

    @contextmanager
    def for_renders(
        self, model: SceneModel, views: Sequence[PinholeView], rasterizer: Rasterizer, monitor: Monitor
    ) -> Iterator[Rasterizer]:
        """Hold memory to render views of one size; yields a ``rasterizer`` of batches that fit into it.

        It waits for other rankings at most. Raises what ``for_training`` raises.
        """
        if self._device.type == "cpu" or not views:
            yield rasterizer
            return
        own_bytes, camera = model_bytes(model.gaussians), views[0].camera
        least_bytes = own_bytes + view_bytes(model.gaussians, camera.width, camera.height)
        most_bytes = max(least_bytes, own_bytes + rasterizer.batch_bytes)
        with self._held("ranking", least_bytes, most_bytes, monitor) as held_bytes:
            fitting = copy.copy(rasterizer)
            fitting.batch_bytes = held_bytes - own_bytes
            yield fitting

    def _limit_bytes(self, kind: _Kind) -> int:
        return round(_SHARES[kind] * self._total_bytes)

    @contextmanager
    def _held(self, kind: _Kind, least_bytes: int, most_bytes: int, monitor: Monitor) -> Iterator[int]:
        while (reserved := self._reserve(kind, least_bytes, most_bytes)) is None:
            monitor.check()
            time.sleep(_POLL_S)
        file, held_bytes = reserved
        try:
            with on_device(self._device):
                yield held_bytes
        except BaseException as error:
            traceback.clear_frames(error.__traceback__)  # they hold tensors
            raise
        finally:
            torch.cuda.empty_cache()  # torch keeps what is free for itself
            Path(file.name).unlink(missing_ok=True)
            file.close()

    def _reserve(self, kind: _Kind, least_bytes: int, most_bytes: int) -> tuple[IO[bytes], int] | None:
        """Reserve what is free between both bounds; None if that is too little, unless none of its kind is.

        A runner is only counted.
        """
        with self._locked():
            held = self._reservations()
            free_bytes = self._limit_bytes(kind) - sum(size for _, size in held)
            if kind != "runner" and free_bytes < least_bytes and any(other == kind for other, _ in held):
                return None
            size = min(max(free_bytes, least_bytes), most_bytes)
            file = (self._folder / f"{kind}-{size}-{secrets.token_hex(8)}").open("xb")
            fcntl.flock(file, fcntl.LOCK_EX)
            return file, size

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Keep other runners from making reservations."""
        with (self._folder / "lock").open("ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _reservations(self) -> list[tuple[str, int]]:
        """Kind and bytes of each; the files of processes that have ended are removed."""
        found = []
        for path in self._folder.glob("*-*"):
            with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    kind, size, _ = path.name.split("-")
                    found.append((kind, int(size)))
                else:
                    path.unlink()
        return found


def _memory_of(device: torch.device) -> tuple[int, str]:
    """A GPU's memory in bytes, and its own name, the same in all processes (its number is not)."""
    properties = torch.cuda.get_device_properties(device)
    return properties.total_memory, str(properties.uuid)
