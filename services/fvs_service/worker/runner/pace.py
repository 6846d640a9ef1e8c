"""How learning gives way to questions, tells how far it is, and is stopped."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from fvs_engine.monitor import Monitor, Progress
from fvs_service.worker.protocol import ProgressNote

_LONGEST_PAUSE_S = 2.0
"""However many questions come, learning takes a step at least so often."""
_REPORT_EVERY_S = 0.2


class Pace:
    """Answers one question after the other; learning pauses between two steps while there are any.

    An answer keeps all cores busy, so that two at once would take twice as long, and twice the memory.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._came = 0
        self._answered = 0

    @contextmanager
    def answering(self) -> Iterator[float]:
        """Have the processor for an answer, after all that came before; yields the seconds that it waited."""
        came = time.monotonic()
        with self._changed:
            place, self._came = self._came, self._came + 1
            self._changed.wait_for(lambda: self._answered == place)
        try:
            yield time.monotonic() - came
        finally:
            with self._changed:
                self._answered += 1
                self._changed.notify_all()

    def give_way(self) -> None:
        """Wait until nothing is to be answered, but not for long."""
        if self._answered == self._came:
            return
        with self._changed:
            self._changed.wait_for(lambda: self._answered == self._came, _LONGEST_PAUSE_S)


class JobMonitor(Monitor):
    """Tells ``on_progress`` of a job, a few times a second; calls ``on_step`` after every training step."""

    def __init__(
        self,
        on_note: Callable[[ProgressNote], None],
        pace: Pace,
        on_step: Callable[[int], None] = lambda _iteration: None,
    ) -> None:
        super().__init__(self._tell)
        self._on_note = on_note
        self._on_step = on_step
        self._pace = pace
        self._told: tuple[str, float] = ("", 0.0)

    def check(self) -> None:
        """See ``Monitor``; questions go first."""
        super().check()
        self._pace.give_way()

    def _tell(self, progress: Progress) -> None:
        if progress.stage == "train":
            self._on_step(progress.done)
        stage, when = self._told
        if stage == progress.stage and time.monotonic() - when < _REPORT_EVERY_S:
            return
        self._told = (progress.stage, time.monotonic())
        share = progress.done / progress.total if progress.total else None
        rate = progress.detail.get("iterations_per_s")
        eta_s = None
        if isinstance(rate, float) and rate > 0 and progress.total:
            eta_s = (progress.total - progress.done) / rate
        self._on_note(ProgressNote(stage=progress.stage, share=share, eta_s=eta_s))
