# Generated from _async/jobs.py by `make generate`. Do not edit.
"""Jobs: create, get, list, wait for, cancel and retry them."""

from collections.abc import Callable, Iterable, Iterator
from typing import Self

from fvs_client import requests
from fvs_client._sync import waiting
from fvs_client._sync.session import Resource, Session
from fvs_client._sync.snapshots import Snapshot
from fvs_client.errors import NotFoundError
from fvs_client.models.resources import JobData
from fvs_schema.jobs import JobKind, JobRequest, JobState


class Job(Resource, JobData):
    """A job as it was when it was fetched; ``refresh`` and ``wait`` return its current state."""

    def refresh(self, *, wait_s: float = 0.0) -> Self:
        """Get the job's current state; with ``wait_s`` once the state has changed, or that time has passed.

        A job that has ended is returned at once. The service waits no longer than 30 s.
        """
        return self._session.fetch(type(self), requests.get_job(self.id, wait_s))

    def wait(
        self, *, timeout_s: float | None = None, on_progress: Callable[[Self], object] | None = None
    ) -> Self:
        """Return the job once it has succeeded; ``on_progress`` gets the job at every change.

        Raises ``JobFailedError``, ``JobCanceledError``, or ``WaitTimeoutError`` while the job continues.
        """
        return waiting.wait(self._session, self, timeout_s, on_progress)

    def cancel(self) -> Self:
        """Cancel the job; one that has ended stays unchanged."""
        return self._session.fetch(type(self), requests.cancel_job(self.id))

    def retry(self) -> Self:
        """Queue a failed or canceled job again; finished stages are not repeated."""
        return self._session.fetch(type(self), requests.retry_job(self.id))

    def snapshot(self) -> Snapshot | None:
        """Get the latest snapshot of this job; None without one, also when it has been deleted."""
        if self.snapshot_id is None:
            return None
        try:
            return self._session.fetch(Snapshot, requests.get_snapshot(self.snapshot_id))
        except NotFoundError:
            return None


class Jobs:
    """Jobs by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, job_id: str) -> Job:
        """Get a job."""
        return self._session.fetch(Job, requests.get_job(job_id))


class SceneJobs:
    """The jobs of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def create(
        self,
        kind: JobKind | str,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Queue a job; a queued job with the same settings is returned instead.

        Raises ``ConflictError`` when a queued job has other settings.
        """
        job = JobRequest(
            kind=JobKind(kind), iterations=iterations, long_side_px=long_side_px, test_every=test_every
        )
        request = requests.create_job(self._scene_id, job, idempotency_key)
        return self._session.fetch(Job, request)

    def list(self, *, state: JobState | str | Iterable[JobState | str] = ()) -> Iterator[Job]:
        """The jobs in one of these states, by default all, newest first."""
        states = (state,) if isinstance(state, str) else state
        return self._session.items(
            Job, requests.jobs_of(self._scene_id), {"state": [str(one) for one in states]}
        )
