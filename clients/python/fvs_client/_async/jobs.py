"""Jobs: create, get, list, wait for, cancel and retry them."""

from collections.abc import AsyncIterator, Callable, Iterable
from typing import Self

from fvs_client import requests
from fvs_client._async import waiting
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client._async.snapshots import AsyncSnapshot
from fvs_client.errors import NotFoundError
from fvs_client.models.resources import JobData
from fvs_schema.jobs import JobKind, JobRequest, JobState


class AsyncJob(AsyncResource, JobData):
    """A job as it was when it was fetched; ``refresh`` and ``wait`` return its current state."""

    async def refresh(self, *, wait_s: float = 0.0) -> Self:
        """Get the job's current state; with ``wait_s`` once the state has changed, or that time has passed.

        A job that has ended is returned at once. The service waits no longer than 30 s.
        """
        return await self._session.fetch(type(self), requests.get_job(self.id, wait_s))

    async def wait(
        self, *, timeout_s: float | None = None, on_progress: Callable[[Self], object] | None = None
    ) -> Self:
        """Return the job once it has succeeded; ``on_progress`` gets the job at every change.

        Raises ``JobFailedError``, ``JobCanceledError``, or ``WaitTimeoutError`` while the job continues.
        """
        return await waiting.wait(self._session, self, timeout_s, on_progress)

    async def cancel(self) -> Self:
        """Cancel the job; one that has ended stays unchanged."""
        return await self._session.fetch(type(self), requests.cancel_job(self.id))

    async def retry(self) -> Self:
        """Queue a failed or canceled job again; finished stages are not repeated."""
        return await self._session.fetch(type(self), requests.retry_job(self.id))

    async def snapshot(self) -> AsyncSnapshot | None:
        """Get the latest snapshot of this job; None without one, also when it has been deleted."""
        if self.snapshot_id is None:
            return None
        try:
            return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(self.snapshot_id))
        except NotFoundError:
            return None


class AsyncJobs:
    """Jobs by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, job_id: str) -> AsyncJob:
        """Get a job."""
        return await self._session.fetch(AsyncJob, requests.get_job(job_id))


class AsyncSceneJobs:
    """The jobs of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def create(
        self,
        kind: JobKind | str,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncJob:
        """Queue a job; a queued job with the same settings is returned instead.

        Raises ``ConflictError`` when a queued job has other settings.
        """
        job = JobRequest(
            kind=JobKind(kind), iterations=iterations, long_side_px=long_side_px, test_every=test_every
        )
        request = requests.create_job(self._scene_id, job, idempotency_key)
        return await self._session.fetch(AsyncJob, request)

    def list(self, *, state: JobState | str | Iterable[JobState | str] = ()) -> AsyncIterator[AsyncJob]:
        """The jobs in one of these states, by default all, newest first."""
        states = (state,) if isinstance(state, str) else state
        return self._session.items(
            AsyncJob, requests.jobs_of(self._scene_id), {"state": [str(one) for one in states]}
        )
