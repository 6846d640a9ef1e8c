# Generated from _async/waiting.py by `make generate`. Do not edit.
"""Wait for a job: over the scene's events, and by polling where events do not arrive."""

import time
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

import httpx2

from fvs_client import requests
from fvs_client._sync.concurrency import sleep
from fvs_client._sync.session import Session
from fvs_client.answers import event_number, parse_event
from fvs_client.errors import ApiError, FvsError, JobCanceledError, JobFailedError, WaitTimeoutError
from fvs_client.models.resources import JobData
from fvs_schema.events import Event, EventKind
from fvs_schema.jobs import JobState

J = TypeVar("J", bound=JobData)

_FIRST_POLL_S, _LONGEST_POLL_S = 0.25, 5.0
_LAST_POLL_S = 1.0
"""Maximum pause between polls when the deadline is near."""
_SILENCE_S = 30.0
"""A stream without a heartbeat for this time is abandoned; this close to the deadline, the job is polled."""


def wait(session: Session, job: J, timeout_s: float | None, on_progress: Callable[[J], object] | None) -> J:
    """Return the job once it has succeeded; ``on_progress`` gets every change.

    The job is fetched whenever a stream of events begins and whenever an event reports a change of its state,
    so the result never depends on events alone. Raises ``JobFailedError``, ``JobCanceledError`` or, when the
    job has not ended after ``timeout_s``, ``WaitTimeoutError``.
    """
    watch = _Watch(session, job, timeout_s, on_progress)
    pause = _FIRST_POLL_S
    while True:
        if watch.left_s > _SILENCE_S:
            began = time.monotonic()
            try:
                ended = watch.follow_events()
            except FvsError as error:
                if isinstance(error, ApiError) and error.status in (401, 403, 404):
                    raise
                ended = watch.poll()
            # Where streams break at once, the pause grows.
            if time.monotonic() - began > _LONGEST_POLL_S:
                pause = _FIRST_POLL_S
        else:
            ended = watch.poll()
        if ended:
            return _succeeded(watch.job)
        if timeout_s is not None and watch.left_s <= 0:
            raise WaitTimeoutError(watch.job, timeout_s)
        sleep(max(0.0, min(pause, watch.left_s)))
        pause = min(2 * pause, _LONGEST_POLL_S if watch.left_s > _SILENCE_S else _LAST_POLL_S)


class _Watch(Generic[J]):
    """The latest known state of one job."""

    def __init__(
        self,
        session: Session,
        job: J,
        timeout_s: float | None,
        on_progress: Callable[[J], object] | None,
    ) -> None:
        self.job = job
        self._session = session
        self._deadline = None if timeout_s is None else time.monotonic() + timeout_s
        self._on_progress = on_progress
        self._reported: tuple[object, ...] = ()
        self._after: int | None = None
        """Number of the last event; None before the first stream."""

    @property
    def left_s(self) -> float:
        """Time to the deadline; infinite without one."""
        return float("inf") if self._deadline is None else self._deadline - time.monotonic()

    def poll(self) -> bool:
        """Fetch the job; return whether it has ended."""
        self._update(self._session.fetch(type(self.job), requests.get_job(self.job.id)))
        return self.job.ended

    def follow_events(self) -> bool:
        """Follow events until the job or the stream ends, or the deadline is near; whether the job ended."""
        request = requests.watch_events(self.job.scene_id, self._after, _SILENCE_S)
        with self._session.open(request) as response:
            ended = self.poll()  # all later changes are in the stream
            if ended:
                return True
            events = httpx2.Response(
                response.status_code,
                headers=response.headers,
                request=response.request,
                content=self._until_deadline(response),
            )
            for message in httpx2.EventSource(events):
                self._after = event_number(message, self._after)
                if message.data and self._apply(parse_event(message)) and self.poll():
                    return True
        return False

    def _until_deadline(self, response: httpx2.Response) -> Iterator[bytes]:
        """The content of a stream of events; heartbeats wake it, so that it ends in time."""
        for chunk in response.iter_raw():
            yield chunk
            if self.left_s <= _SILENCE_S:
                return

    def _apply(self, event: Event) -> bool:
        """Take the progress from an event; return whether the event means that the job must be fetched."""
        if event.data.get("job_id") != self.job.id:
            return False
        if event.kind is not EventKind.JOB_PROGRESS:
            return True
        progress = event.data.get("progress")
        running = self.job.state is JobState.RUNNING
        if running and isinstance(progress, float | int) and progress >= self.job.progress:
            changes = {name: event.data.get(name) for name in ("stage", "eta_s")}
            self._update(self.job.model_copy(update={**changes, "progress": float(progress)}))
        return False

    def _update(self, job: J) -> None:
        self.job = job
        report = (job.state, job.stage, job.progress, job.eta_s, job.attempt)
        if self._on_progress is not None and report != self._reported:
            self._on_progress(job)
        self._reported = report


def _succeeded(job: J) -> J:
    if job.state is JobState.FAILED:
        raise JobFailedError(job)
    if job.state is JobState.CANCELED:
        raise JobCanceledError(job)
    return job
