"""Progress on stderr: bars for people, lines for logs, JSON lines for machines."""

import json
import sys
import threading
import time
from collections.abc import Mapping
from types import TracebackType
from typing import IO, Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import (
    Progress as RichProgress,
)
from rich.table import Column
from rich.text import Text

from fvs_engine.monitor import Progress
from fvs_engine.wording import notice, text
from fvs_schema.findings import Finding
from fvs_schema.stages import Stage

_LOG_EVERY_S = 10.0
_JSON_EVERY_S = 0.2
_WIDE_COLUMNS = 110
"""Terminal width from which a bar is long and has details beside the times."""

_LABELS: Mapping[Stage, str] = {
    Stage.IMAGES: "Checking photographs",
    Stage.NORMALISE: "Preparing photographs",
    Stage.FEATURES: "Finding features",
    Stage.PAIRS: "Choosing pairs",
    Stage.MATCHING: "Matching pairs",
    Stage.CALIBRATION: "Calibrating",
    Stage.EVIDENCE: "Checking the evidence",
    Stage.UNDISTORT: "Undistorting",
    Stage.LOAD: "Loading views",
    Stage.PHOTOGRAPHS: "Taking photographs",
    Stage.FRAMES: "Taking frames, by seconds",
    Stage.COMPILE: "Compiling kernels, once",
    Stage.TRAINING: "Training",
    Stage.CLEANING: "Finding floaters",
    Stage.EVALUATE: "Rendering held-out views",
    Stage.SELECT: "Selecting views",
    Stage.ESTIMATE: "Estimating candidates",
    Stage.SCORE: "Scoring candidates",
    Stage.CONTACT_SHEET: "Writing the contact sheet",
    Stage.RENDER: "Rendering",
}


class Display(Protocol):
    """Shows progress while it is entered; ``update`` may be called from any thread."""

    def __enter__(self) -> "Display": ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def update(self, progress: Progress) -> None:
        """Show one report."""
        ...

    def show(self, message: str) -> None:
        """Show a message."""
        ...

    def warn(self, finding: Finding) -> None:
        """Show a warning."""
        ...


def create_display(*, machine: bool) -> Display:
    """JSON lines for machines, bars on a terminal, lines elsewhere."""
    if machine:
        return JsonDisplay(sys.stderr)
    if sys.stderr.isatty():
        return BarDisplay(Console(stderr=True))
    return LogDisplay(sys.stderr)


def label_of(stage: Stage) -> str:
    """The displayed name of a stage."""
    return _LABELS.get(stage) or stage.value.replace("-", " ").capitalize()


def _details(progress: Progress) -> str:
    parts = []
    for name, value in progress.detail.items():
        if name.endswith("_per_s"):
            continue  # the bar shows the rate in its own column
        shown = (
            f"{value:.4g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else value
        )
        parts.append(f"{name.replace('_', ' ')} {shown}")
    return ", ".join(parts)


def _rate(progress: Progress) -> float | int | str | None:
    """The rate that the stage reports itself, if any."""
    return next((value for name, value in progress.detail.items() if name.endswith("_per_s")), None)


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.fields["rate"] or task.finished_speed or task.speed
        return Text(f"{speed:,.1f}/s" if speed else "", style="progress.data.speed")


class BarDisplay:
    """One bar per stage, with its rate, the time it took and the time left."""

    def __init__(self, console: Console) -> None:
        self._console = console
        wide = console.width >= _WIDE_COLUMNS
        columns: list[ProgressColumn] = [
            SpinnerColumn(finished_text="[green]✓"),
            TextColumn("{task.description:25}"),
            BarColumn(bar_width=24 if wide else 10),
            TextColumn("{task.fields[count]:>13}"),
            _Rate(table_column=Column(no_wrap=True)),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        ]
        if wide:
            columns.append(TextColumn("[dim]{task.fields[detail]}"))
        self._bars = RichProgress(
            *columns,
            console=console,
            speed_estimate_period=60,
        )
        self._tasks: dict[Stage, TaskID] = {}
        self._lock = threading.Lock()

    def __enter__(self) -> "BarDisplay":
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bars.stop()

    def update(self, progress: Progress) -> None:
        """Move the stage's bar; a stage that begins ends the ones before it."""
        with self._lock:
            task = self._tasks.get(progress.stage)
            completed = progress.done
            if progress.total and progress.share is not None:
                completed = round(progress.share * progress.total)
            count = f"{progress.done:,}" + (f"/{progress.total:,}" if progress.total else "")
            if task is None:
                for earlier in self._tasks.values():
                    self._end(earlier)
                # A resumed stage begins at ``done``; its rate must not count earlier work.
                task = self._bars.add_task(
                    label_of(progress.stage),
                    total=progress.total,
                    completed=completed,
                    count="",
                    rate=None,
                    detail="",
                )
                self._tasks[progress.stage] = task
            self._bars.update(
                task,
                completed=completed,
                total=progress.total,
                count=count,
                rate=_rate(progress),
                detail=_details(progress),
            )

    def show(self, message: str) -> None:
        """Print above the bars."""
        self._console.print(message, markup=False, highlight=False)

    def warn(self, finding: Finding) -> None:
        """Print its sentences above the bars."""
        self.show(text(finding))

    def _end(self, task: TaskID) -> None:
        state = next(known for known in self._bars.tasks if known.id == task)
        if not state.finished:
            self._bars.update(task, total=max(state.completed, 1), completed=max(state.completed, 1))


class _StreamDisplay:
    """Writes to a stream, from any thread."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._lock = threading.Lock()
        self._stage: Stage | None = None
        self._shown = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.flush()

    def _write(self, line: str) -> None:
        self._stream.write(line + "\n")
        self._stream.flush()


class LogDisplay(_StreamDisplay):
    """A line when a stage begins, every ten seconds, and when it ends."""

    def __init__(self, stream: IO[str]) -> None:
        super().__init__(stream)
        self._began = (0.0, 0, 0.0)
        self._ended = False

    def update(self, progress: Progress) -> None:
        """Write a line if one is due."""
        with self._lock:
            now = time.monotonic()
            begins = progress.stage != self._stage
            if begins:
                self._stage, self._began = progress.stage, (now, progress.done, progress.share or 0.0)
            ends = progress.done == progress.total
            due = begins or (ends and not self._ended) or now - self._shown >= _LOG_EVERY_S
            self._ended = ends
            if not due:
                return
            self._shown = now
            line = f"{label_of(progress.stage)}: {progress.done:,}"
            if progress.total:
                line += f"/{progress.total:,}"
            seconds, done = now - self._began[0], progress.done - self._began[1]
            if seconds > 0 and done > 0:
                line += f", {done / seconds:,.1f}/s"
                worked = (progress.share or 0.0) - self._began[2]
                if progress.share is not None and worked > 0 and not ends:
                    line += f", {(1 - progress.share) * seconds / worked:,.0f} s left"
            details = _details(progress)
            self._write(f"{line}, {details}" if details else line)

    def show(self, message: str) -> None:
        """Write a line."""
        with self._lock:
            self._write(message)

    def warn(self, finding: Finding) -> None:
        """Write its sentences as a line."""
        self.show(text(finding))


class JsonDisplay(_StreamDisplay):
    """One JSON object per line: ``{"stage", "done", "total", …}``, ``{"message"}`` or ``{"warning"}``."""

    def update(self, progress: Progress) -> None:
        """Write the report unless the last one was written within ``_JSON_EVERY_S``."""
        with self._lock:
            now = time.monotonic()
            ends = progress.done == progress.total
            if progress.stage == self._stage and not ends and now - self._shown < _JSON_EVERY_S:
                return
            self._stage, self._shown = progress.stage, now
            report = {
                **progress.detail,
                "stage": progress.stage,
                "done": progress.done,
                "total": progress.total,
            }
            self._write(json.dumps(report))

    def show(self, message: str) -> None:
        """Write the message."""
        with self._lock:
            self._write(json.dumps({"message": message}))

    def warn(self, finding: Finding) -> None:
        """Write the record, with its sentences, as the service answers it."""
        with self._lock:
            self._write(json.dumps({"warning": notice(finding).model_dump(mode="json")}))
