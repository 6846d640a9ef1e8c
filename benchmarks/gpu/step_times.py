"""Times of a training step by its parts, its synchronisations, memory and kernels."""

import gc
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from proof import Extent, with_harmonics
from room import candidates, scene

from fvs_engine.monitor import Monitor
from fvs_engine.splat import densification as densification_module
from fvs_engine.splat import optimiser as optimiser_module
from fvs_engine.splat import trainer as trainer_module
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.settings import Densification
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView

_NEVER = 10**6
_KERNELS = 20
_RUNTIME_CALLS = ("Synchronize", "cudaMemcpy", "cudaMalloc", "cudaHostAlloc", "LaunchKernel", "cudaFree")
SYNCHRONISING = "called a synchronizing"
"""What torch's warnings of synchronisations say, but not the one that its debug mode is a prototype."""


def timed_steps(rasterizer: Rasterizer, extent: Extent, count: int, sh_degree: int) -> dict[str, Any]:
    """Milliseconds of a step and of its parts, the median of some steps.

    Events are recorded on the device, so a part lasts until the host has launched it. ``by the clock`` are
    steps without events, as training has them.
    """
    device = rasterizer.device
    trainer = _trainer(rasterizer, extent, count, sh_degree)
    trainer.train(4, Monitor())
    reset_peak(device)
    before_gib = allocated_gib(device)
    watch = Watch(device)
    with _watched(watch, rasterizer):
        for _ in range(extent.timed_steps):
            with watch.part("step"):
                trainer._step(_NEVER)
    trainer._settle(0)
    found: dict[str, Any] = {f"{name} ms": watch.median_ms(name) for name in watch.events}
    found |= {"model GiB": before_gib, "peak GiB": peak_gib(device)}
    start = time.perf_counter()
    trainer.train(trainer.iteration + extent.timed_steps, Monitor())
    wait_for(device)
    found["step by the clock ms"] = 1e3 * (time.perf_counter() - start) / extent.timed_steps
    start = time.perf_counter()
    for _ in range(4):
        trainer._in_flight.clear()  # as many in flight as the queue takes
        trainer._step(_NEVER)
    found["host's share ms"] = 1e3 * (time.perf_counter() - start) / 4
    trainer._settle(0)
    wait_for(device)
    if device.type == "cuda":
        found |= _synchronisations(trainer)
    return found


def _trainer(rasterizer: Rasterizer, extent: Extent, count: int, sh_degree: int) -> Trainer:
    """A trainer of a room that is to look like noise, without densification."""
    (view,) = candidates(1, *extent.timed)
    width, height = extent.timed
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    training = [TrainingView(view.name, view.camera, view.camera_from_model, image)]
    settings = extent.settings.model_copy(
        update={
            "sh_degree": sh_degree,
            "sh_degree_interval": 1,
            "densification": Densification(first_iteration=_NEVER, last_iteration=_NEVER),
        }
    )
    return Trainer(training, with_harmonics(scene(count), sh_degree), settings, rasterizer)


def _synchronisations(trainer: Trainer) -> dict[str, Any]:
    """Where a step waits for the device, as torch's debug mode has it, and how often for an event.

    The debug mode knows neither events, nor what a driver's allocation waits for.
    """
    waits = 0
    wait = torch.cuda.Event.synchronize

    def counted(event: torch.cuda.Event) -> None:
        nonlocal waits
        waits += 1
        wait(event)

    trainer._step(_NEVER)
    with (
        warnings.catch_warnings(record=True) as caught,
        patch.object(torch.cuda.Event, "synchronize", counted),
    ):
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            trainer._step(_NEVER)
        finally:
            torch.cuda.set_sync_debug_mode("default")
    trainer._settle(0)
    where = [f"{w.filename.rpartition('/')[2]}:{w.lineno}" for w in caught if SYNCHRONISING in str(w.message)]
    return {"synchronisations": len(where), "synchronised at": where, "events waited for": waits}


def profiled_step(rasterizer: Rasterizer, extent: Extent, count: int, sh_degree: int) -> dict[str, Any]:
    """The kernels that take longest in a step, in µs, and the calls of the driver."""
    from torch.autograd import DeviceType
    from torch.profiler import ProfilerActivity, profile

    trainer = _trainer(rasterizer, extent, count, sh_degree)
    trainer.train(4, Monitor())
    activities = [ProfilerActivity.CPU]
    if rasterizer.device.type == "cuda":
        activities.append(ProfilerActivity.CUDA)
    with profile(activities=activities) as profiler:
        for _ in range(extent.timed_steps):
            trainer._step(_NEVER)
        trainer._settle(0)
        wait_for(rasterizer.device)
    averages = profiler.key_averages()
    kernels = sorted(
        (one for one in averages if one.device_type == DeviceType.CUDA),
        key=lambda one: -one.self_device_time_total,
    )
    calls = [one for one in averages if any(part in one.key for part in _RUNTIME_CALLS)]
    return {
        "kernels µs": {
            one.key[:60]: round(one.self_device_time_total / extent.timed_steps, 1)
            for one in kernels[:_KERNELS]
        },
        "all kernels µs": sum(one.self_device_time_total for one in kernels) / extent.timed_steps,
        "calls": {one.key: one.count / extent.timed_steps for one in calls},
    }


class Watch:
    """CUDA events around the parts of a step; wall-clock times on a CPU."""

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self.events: dict[str, list[tuple[Any, Any]]] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time the block."""
        begin = self._now()
        try:
            yield
        finally:
            self.events.setdefault(name, []).append((begin, self._now()))

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.part(name):
                return function(*args, **kwargs)

        return timed

    def all_ms(self, name: str) -> list[float]:
        """The time of every run of a part."""
        wait_for(self._device)
        if self._device.type != "cuda":
            return [1e3 * (end - begin) for begin, end in self.events[name]]
        return [begin.elapsed_time(end) for begin, end in self.events[name]]

    def median_ms(self, name: str) -> float:
        """The median of them."""
        return median(self.all_ms(name))

    def _now(self) -> Any:
        if self._device.type != "cuda":
            return time.perf_counter()
        event = torch.cuda.Event(enable_timing=True)
        event.record()
        return event


@contextmanager
def _watched(watch: Watch, rasterizer: Rasterizer) -> Iterator[None]:
    """Time the parts of the steps that run in the block; the rest of a step is its bookkeeping."""
    render = "render_guarded" if hasattr(rasterizer, "render_guarded") else "render"
    targets: list[tuple[str, Any, str]] = [
        ("render", type(rasterizer), render),
        ("loss", trainer_module, "photometric_loss"),
        ("backward", torch.Tensor, "backward"),
        ("adam", optimiser_module.GaussianAdam, "step"),
        ("statistics", densification_module.GradientStatistics, "add"),
    ]
    with ExitStack() as stack:
        for name, owner, attribute in targets:
            timed = watch.wrap(name, getattr(owner, attribute))
            stack.enter_context(patch.object(owner, attribute, timed))
        yield


def wait_for(device: torch.device) -> None:
    """Wait for all that the device was given."""
    if device.type == "cuda":
        torch.cuda.synchronize()


def reset_peak(device: torch.device) -> None:
    """Empty the cache of the allocator and reset the peak of its memory."""
    gc.collect()
    if device.type == "cuda":
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()


def allocated_gib(device: torch.device) -> float:
    """Memory that is allocated now."""
    return torch.cuda.memory_allocated() / 2**30 if device.type == "cuda" else 0.0


def peak_gib(device: torch.device) -> float:
    """What was held at most since ``reset_peak``."""
    return torch.cuda.max_memory_allocated() / 2**30 if device.type == "cuda" else 0.0
