"""How a long computation reports progress and learns that it should stop."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fvs_engine.errors import Cancelled


@dataclass(frozen=True)
class Progress:
    """One report: ``done`` of ``total`` units of ``stage`` (``total`` is None when not known)."""

    stage: str
    done: int
    total: int | None
    detail: Mapping[str, float | int | str] = field(default_factory=dict)


class Monitor:
    """The line between a computation and whoever started it.

    ``on_progress`` is called in the computing thread; it must return quickly. ``cancel`` may be called
    from any thread or from a signal handler; the computation then raises ``Cancelled`` at its next
    ``check``, having left a resumable state behind.
    """

    def __init__(self, on_progress: Callable[[Progress], None] | None = None) -> None:
        self._on_progress = on_progress
        self._cancelled = threading.Event()

    def report(self, stage: str, done: int, total: int | None = None, **detail: float | int | str) -> None:
        """Tell that ``done`` units of ``stage`` are finished."""
        if self._on_progress is not None:
            self._on_progress(Progress(stage, done, total, detail))

    def cancel(self) -> None:
        """Ask the computation to stop at its next safe point."""
        self._cancelled.set()

    @property
    def cancelled(self) -> bool:
        """Whether somebody asked to stop."""
        return self._cancelled.is_set()

    def check(self) -> None:
        """Raise ``Cancelled`` if somebody asked to stop."""
        if self._cancelled.is_set():
            raise Cancelled("Stopped on request.", hint="Run the same command again to resume.")


class SavingMonitor(Monitor):
    """Passes on to ``outer``, and calls ``save`` every ``every_s`` seconds, at safe points."""

    def __init__(self, outer: Monitor, save: Callable[[], None], every_s: float) -> None:
        super().__init__()
        self._outer = outer
        self._save = save
        self._every_s = every_s
        self._saved = time.monotonic()

    def report(self, stage: str, done: int, total: int | None = None, **detail: float | int | str) -> None:
        """See ``Monitor``."""
        self._outer.report(stage, done, total, **detail)

    def cancel(self) -> None:
        """See ``Monitor``."""
        self._outer.cancel()

    @property
    def cancelled(self) -> bool:
        """See ``Monitor``."""
        return self._outer.cancelled

    def check(self) -> None:
        """Save when it is time; raise ``Cancelled`` if somebody asked to stop."""
        self._outer.check()
        if time.monotonic() - self._saved > self._every_s:
            self._save()
            self._saved = time.monotonic()
