"""Waiting for a job: over events while they come, by asking while they do not."""

import time
from collections.abc import Callable
from typing import Generic, TypeVar

from fvs_client import requests
from fvs_client.effects import Close, Deadline, Operation, Sleep, read
from fvs_client.errors import (
    ApiError,
    FvsError,
    JobCanceledError,
    JobFailedError,
    WaitTimeoutError,
)
from fvs_client.exchange import exchange, opened, parse
from fvs_client.models.events import Event, EventKind
from fvs_client.models.jobs import JobData, JobState
from fvs_client.operations.events import MessageDecoder, events_in
from fvs_client.retries import Retries

J = TypeVar("J", bound=JobData)

_POLL_S = (0.25, 5.0)
"""The first pause between two questions, and the longest."""
_SILENCE_S = 30.0
"""A stream of events that says nothing for so long, not even that it lives, is given up."""


class _Watch(Generic[J]):
    """What is known of one job, and who wants to know."""

    job: J

    def __init__(
        self,
        kind: type[J],
        job_id: str,
        on_progress: Callable[[J], object] | None,
        retries: Retries,
        session: object,
    ) -> None:
        self._kind, self._id, self._session = kind, job_id, session
        self._on_progress = on_progress
        self._retries = retries
        self._shown: tuple[object, ...] = ()

    def ask(self) -> Operation[bool]:
        """Ask the service; whether the job has ended."""
        reply = yield from exchange(requests.get_job(self._id), self._retries)
        self._show(parse(self._kind, reply.content, self._session))
        return self.job.ended

    def hear(self, event: Event) -> bool:
        """Take progress from an event; whether the event tells more than it says, so that to ask is due."""
        if event.data.get("job_id") != self._id:
            return False
        if event.kind is not EventKind.JOB_PROGRESS:
            return True
        progress = event.data.get("progress")
        running = self.job.state is JobState.RUNNING
        if running and isinstance(progress, float | int) and progress >= self.job.progress:
            told = {name: event.data.get(name) for name in ("stage", "eta_s")}
            self._show(self.job.model_copy(update={**told, "progress": float(progress)}))
        return False

    def _show(self, job: J) -> None:
        self.job = job
        shown = (job.state, job.stage, job.progress, job.eta_s, job.attempt)
        if self._on_progress is not None and shown != self._shown:
            self._on_progress(job)
        self._shown = shown


def wait(
    kind: type[J],
    job_id: str,
    scene_id: str,
    *,
    timeout_s: float | None,
    on_progress: Callable[[J], object] | None,
    retries: Retries,
    session: object,
) -> Operation[J]:
    """Return the job once it has succeeded; ``on_progress`` is told of every change.

    The service is asked once whenever a stream of events begins, and whenever an event says that the job's
    state changed, so what is returned is what the service has, not what events made believe. Raises
    ``JobFailedError``, ``JobCanceledError`` or, while the job goes on, ``WaitTimeoutError``.
    """
    watch = _Watch(kind, job_id, on_progress, retries, session)
    deadline = Deadline(timeout_s)
    pause, after = _POLL_S[0], None
    while True:
        if deadline.left_s > _SILENCE_S:
            began = time.monotonic()
            try:
                ended, after = yield from _over_events(watch, scene_id, after, deadline)
            except FvsError as error:
                if isinstance(error, ApiError) and error.status in (401, 403, 404):
                    raise
                ended = yield from watch.ask()
            if (
                time.monotonic() - began > _POLL_S[1]
            ):  # else something ends every stream: ask ever more rarely
                pause = _POLL_S[0]
        else:
            ended = yield from watch.ask()
        if ended:
            return _succeeded(watch.job)
        if timeout_s is not None and deadline.left_s <= 0:
            raise WaitTimeoutError(watch.job, timeout_s)
        yield Sleep(max(0.0, min(pause, deadline.left_s)))
        pause = min(2 * pause, _POLL_S[1] if deadline.left_s > _SILENCE_S else 1.0)


def _over_events(
    watch: _Watch[J], scene_id: str, after: int | None, deadline: Deadline
) -> Operation[tuple[bool, int | None]]:
    """Watch until the job or the stream ends, or the deadline is near.

    Returns whether the job has ended, and the last event that was seen.
    """
    reply = yield from opened(requests.watch_events(scene_id, after, _SILENCE_S))
    ended = yield from watch.ask()  # what happens from now on is in the stream
    decoder = MessageDecoder()
    while not ended and deadline.left_s > _SILENCE_S:
        chunk = yield from read(reply.stream)
        if chunk is None:
            break
        due = False
        for event in events_in(decoder, chunk):
            after = event.number
            due = watch.hear(event) or due
        if due:
            ended = yield from watch.ask()
    yield Close(reply.stream)
    return ended, after


def _succeeded(job: J) -> J:
    if job.state is JobState.FAILED:
        raise JobFailedError(job)
    if job.state is JobState.CANCELED:
        raise JobCanceledError(job)
    return job
