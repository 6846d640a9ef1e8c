"""Progress on stderr: bars on a terminal, occasional lines elsewhere, JSON lines for programs."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TransferSpeedColumn,
)
from rich.text import Text

from fvs_client.downloads import DownloadProgress
from fvs_client.models.resources import JobData
from fvs_client.uploads import UploadedFile, UploadProgress
from fvs_schema.jobs import JobWaiting
from fvs_schema.rankings import ScoredCandidate

_LOG_EVERY_S = 10.0
_JSON_EVERY_S = 0.2


class Display(Protocol):
    """Displays the progress of one operation."""

    def show(self, done: float, total: float, text: str, details: dict[str, object]) -> None:
        """Show ``done`` of ``total``, with a ``text`` for people and ``details`` for programs."""
        ...

    def print(self, line: str) -> None:
        """Print a line that stays."""
        ...


@contextmanager
def display(label: str, *, as_json: bool, in_bytes: bool = False) -> Iterator[Display]:
    """Open the display that suits stderr."""
    if as_json:
        yield _Lines(label, machine=True)
    elif not sys.stderr.isatty():
        yield _Lines(label, machine=False)
    else:
        columns: list[ProgressColumn] = [SpinnerColumn(), TextColumn("{task.description}"), BarColumn()]
        columns += [DownloadColumn(), TransferSpeedColumn()] if in_bytes else [_Percent()]
        columns += [TimeElapsedColumn(), TextColumn("{task.fields[text]}")]
        with Progress(*columns, console=Console(stderr=True)) as progress:
            yield _Bar(progress, label)


def upload_progress(shown: Display, progress: UploadProgress) -> None:
    """Show the progress of an upload."""
    details: dict[str, object] = {
        "files_done": progress.files_done,
        "files_total": progress.files_total,
        "bytes_sent": progress.bytes_sent,
    }
    text = f"{progress.files_done} of {progress.files_total}"
    done = progress.bytes_done
    if progress.files_done < progress.files_total:  # all bytes may be sent while verdicts are missing
        done = min(done, progress.bytes_total - 1)
    shown.show(done, progress.bytes_total, text, details)


def describe_outcome(file: UploadedFile) -> str:
    """Outcome of a file, with its error or verdict."""
    error = file.error or file.mask_error
    if error is not None:
        outcome = "failed" if file.error else f"{file.outcome.value.replace('-', ' ')} without its mask"
        return f"{outcome}: {getattr(error, 'message', error)} {getattr(error, 'hint', '')}".rstrip()
    if file.image is None or file.image.accepted:
        warnings = ", ".join(file.image.warnings) if file.image else ""
        return f"{file.outcome.value.replace('-', ' ')}{f' ({warnings})' if warnings else ''}"
    return f"{file.image.verdict.value}: {file.image.reason}"


def job_progress(shown: Display, job: JobData) -> None:
    """Show the progress of a job."""
    details: dict[str, object] = {"state": job.state.value, "stage": job.stage, "eta_s": job.eta_s}
    if job.waiting is None:
        left = "" if job.eta_s is None else f", about {_duration(job.eta_s)} left"
        text = f"{job.stage or (job.state.value if job.state.ended else 'its runner starts')}{left}"
    else:
        details["waiting"] = job.waiting.model_dump(mode="json")
        text = describe_waiting(job.waiting)
    shown.show(job.progress, 1.0, text, details)


def describe_waiting(waiting: JobWaiting) -> str:
    """Why a job waits, and about how long."""
    soon = "" if not waiting.eta_s else f" About {_duration(waiting.eta_s)}."
    return f"waits, number {waiting.place} in the queue. {waiting.message}{soon}"


def download_progress(shown: Display, progress: DownloadProgress) -> None:
    """Show the progress of a download."""
    shown.show(progress.bytes_done, progress.bytes_total, progress.name, {"name": progress.name})


@contextmanager
def ranking_progress(*, as_json: bool) -> Iterator[Callable[[tuple[ScoredCandidate, ...]], None] | None]:
    """Show on a terminal how many candidates of a ranking are scored; elsewhere None.

    Their number is not known before: a generator makes them.
    """
    if as_json or not sys.stderr.isatty():
        yield None
        return
    scored: set[str] = set()  # a candidate can come twice
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("Ranking")

        def on_scored(candidates: tuple[ScoredCandidate, ...]) -> None:
            scored.update(candidate.id for candidate in candidates)
            progress.update(task, description=f"Ranking: {len(scored)} scored")

        yield on_scored


class _Percent(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.percentage:3.0f}%")


class _Bar:
    def __init__(self, progress: Progress, label: str) -> None:
        self._progress = progress
        self._task = progress.add_task(label, total=None, text="")

    def show(self, done: float, total: float, text: str, details: dict[str, object]) -> None:  # noqa: ARG002
        self._progress.update(self._task, completed=done, total=total or 1.0, text=text)

    def print(self, line: str) -> None:
        self._progress.console.print(line, markup=False, highlight=False)


class _Lines:
    def __init__(self, label: str, *, machine: bool) -> None:
        self._label, self._machine = label, machine
        self._last_time, self._last_text = float("-inf"), ""

    def show(self, done: float, total: float, text: str, details: dict[str, object]) -> None:
        pause = _JSON_EVERY_S if self._machine else _LOG_EVERY_S
        stage = str(details.get("stage") or details.get("state") or "")
        finished = done >= total
        if time.monotonic() - self._last_time < pause and stage == self._last_text and not finished:
            return
        self._last_time, self._last_text = time.monotonic(), stage
        share = done / total if total else 1.0
        if self._machine:
            document = {"progress": {"of": self._label, "share": round(share, 4), **details}}
            print(json.dumps(document, ensure_ascii=False), file=sys.stderr, flush=True)  # noqa: T201
        else:
            print(f"{self._label}: {share:4.0%}  {text}", file=sys.stderr, flush=True)  # noqa: T201

    def print(self, line: str) -> None:
        if not self._machine:
            print(line, file=sys.stderr, flush=True)  # noqa: T201


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
