"""Progress reports of a long computation, its findings and results so far, and the request to stop it."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from fvs_engine.errors import Cancelled
from fvs_schema.findings import Finding
from fvs_schema.stages import Stage


@dataclass(frozen=True)
class Progress:
    """One report: ``done`` of ``total`` units of ``stage`` (``total`` is None when not known).

    ``worked``: the share of the stage's work, where its units differ in their work.
    """

    stage: Stage
    done: int
    total: int | None
    detail: Mapping[str, float | int | str] = field(default_factory=dict)
    worked: float | None = None

    @property
    def share(self) -> float | None:
        """The share of the stage's work that is done, in [0, 1]; None when not known."""
        if self.worked is not None:
            return self.worked
        return self.done / self.total if self.total else None


class Monitor:
    """Receives the progress of a computation, and carries the request to stop it.

    The callbacks are called in the computing thread; they must return quickly.
    ``cancel`` may be called from any thread or from a signal handler; the computation then raises
    ``Cancelled`` at its next ``check``, having left a resumable state behind.
    """

    def __init__(
        self,
        on_progress: Callable[[Progress], None] | None = None,
        on_results: Callable[[Sequence[object]], None] | None = None,
        on_warning: Callable[[Finding], None] | None = None,
    ) -> None:
        self._on_progress = on_progress
        self._on_results = on_results
        self._on_warning = on_warning
        self._cancelled = threading.Event()

    def report(
        self,
        stage: Stage,
        done: int,
        total: int | None = None,
        *,
        worked: float | None = None,
        **detail: float | int | str,
    ) -> None:
        """Report that ``done`` units of ``stage`` are finished; ``worked`` as in ``Progress``."""
        self.receive(Progress(stage, done, total, detail, worked))

    def receive(self, progress: Progress) -> None:
        """Handle one report; subclasses may forward or drop it."""
        if self._on_progress is not None:
            self._on_progress(progress)

    def pass_on(self, results: Sequence[object]) -> None:
        """Pass on a part of the results that is known before the end: the scores of some candidates."""
        if self._on_results is not None:
            self._on_results(results)

    def warn(self, finding: Finding) -> None:
        """Pass on what the user should know about the result."""
        if self._on_warning is not None:
            self._on_warning(finding)

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
