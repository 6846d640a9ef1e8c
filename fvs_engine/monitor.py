"""Progress reports of a long computation, and the request to stop it."""

import threading
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
    """Receives the progress of a computation, and carries the request to stop it.

    ``on_progress`` is called in the computing thread; it must return quickly. ``cancel`` may be called
    from any thread or from a signal handler; the computation then raises ``Cancelled`` at its next
    ``check``, having left a resumable state behind.
    """

    def __init__(self, on_progress: Callable[[Progress], None] | None = None) -> None:
        self._on_progress = on_progress
        self._cancelled = threading.Event()

    def report(self, stage: str, done: int, total: int | None = None, **detail: float | int | str) -> None:
        """Report that ``done`` units of ``stage`` are finished."""
        if self._on_progress is not None:
            self._on_progress(Progress(stage, done, total, detail))

    def cancel(self) -> None:
        """Request the computation to stop at its next safe point."""
        self._cancelled.set()

    @property
    def cancelled(self) -> bool:
        """Whether ``cancel`` was called."""
        return self._cancelled.is_set()

    def check(self) -> None:
        """Raise ``Cancelled`` if ``cancel`` was called."""
        if self._cancelled.is_set():
            raise Cancelled("Stopped on request.", hint="Run the same command again to resume.")
