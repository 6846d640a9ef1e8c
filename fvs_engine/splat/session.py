"""Resumable training, saved at intervals and on cancellation."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.settings import TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView, points_that_count
from fvs_schema.stages import Stage

SAVE_EVERY_S = 60.0


def open_trainer(
    checkpoint: Path,
    views: Sequence[TrainingView],
    points: tuple[NDArray[np.float64], NDArray[np.uint8]],
    settings: TrainingSettings,
    rasterizer: Rasterizer,
    seed: int = 0,
) -> Trainer:
    """Resume the trainer of ``checkpoint``, or create one with Gaussians on ``points`` and of their colours.

    None is on a point that masked pixels alone show.
    A resumed trainer uses ``settings``: the same ones give the same result, more iterations the schedule of
    the longer run. Raises what ``Trainer`` and ``Trainer.resume`` raise.
    """
    if not checkpoint.exists():
        xyz, colors = points
        counts = points_that_count(xyz, views)
        gaussians = initialise_from_points(xyz[counts], colors[counts], settings.sh_degree)
        return Trainer(views, gaussians, settings, rasterizer, seed)
    trainer = Trainer.resume(checkpoint, views, rasterizer)
    trainer.settings = settings
    return trainer


def train_saving(
    trainer: Trainer,
    until_iteration: int,
    monitor: Monitor,
    save: Callable[[], None],
    stage: Stage = Stage.TRAINING,
) -> None:
    """Train up to ``until_iteration``, calling ``save`` every minute and when cancelled.

    The caller saves what follows the last save. Raises what ``Trainer.train`` raises.
    """
    try:
        trainer.train(until_iteration, SavingMonitor(monitor, save, SAVE_EVERY_S), stage)
    except Cancelled:
        save()
        raise


class SavingMonitor(Monitor):
    """Forwards to ``outer``, and calls ``save`` every ``every_s`` seconds, between two iterations."""

    def __init__(self, outer: Monitor, save: Callable[[], None], every_s: float) -> None:
        super().__init__()
        self._outer = outer
        self._save = save
        self._every_s = every_s
        self._saved = time.monotonic()

    def receive(self, progress: Progress) -> None:
        """See ``Monitor``."""
        self._outer.receive(progress)

    def cancel(self) -> None:
        """See ``Monitor``."""
        self._outer.cancel()

    @property
    def cancelled(self) -> bool:
        """See ``Monitor``."""
        return self._outer.cancelled

    def check(self) -> None:
        """Save when it is due; raise ``Cancelled`` if the outer monitor was cancelled."""
        self._outer.check()
        if time.monotonic() - self._saved > self._every_s:
            self._save()
            self._saved = time.monotonic()
