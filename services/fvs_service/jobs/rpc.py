"""Jobs over gRPC."""

from collections.abc import AsyncIterator
from typing import Annotated

from anyio.to_thread import run_sync
from fvs.v1 import jobs_pb2 as pb
from pydantic import Field

from fvs_schema.base import Model
from fvs_schema.jobs import Job, JobList, JobPage, JobRequest
from fvs_schema.quantities import Number
from fvs_service.application import Application
from fvs_service.errors import stopping
from fvs_service.gateway.job_wait import MOST_S, changed_job
from fvs_service.gateway.rpc.calls import Call
from fvs_service.gateway.rpc.conversion import pick, read
from fvs_service.gateway.rpc.requests import idempotency_key
from fvs_service.principal import Principal, Scope


class _Wait(Model):
    wait_s: Annotated[Number, Field(ge=0, le=MOST_S)] = 0.0


class JobServicer:
    """``fvs.v1.JobService``."""

    service = pb.DESCRIPTOR.services_by_name["JobService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    def create_job(self, caller: Principal, request: pb.CreateJobRequest) -> Job:
        """Queue a job."""
        self._app.scenes.require(caller, Scope.OPERATE, request.scene_id)
        job = read(JobRequest, request.job)
        return self._app.jobs.create(caller, request.scene_id, job, idempotency_key(request))

    def list_jobs(self, caller: Principal, request: pb.ListJobsRequest) -> JobList:
        """List the jobs of a scene."""
        page = pick(JobPage, request)
        return self._app.jobs.of_scene(caller, request.scene_id, page)

    async def get_job(self, call: Call, caller: Principal, request: pb.GetJobRequest) -> Job:
        """Return a job, at once or when its state has changed."""
        within_s, parts = pick(_Wait, request).wait_s, call.gateway
        return await changed_job(self._app, parts.feed, parts.metrics, caller, request.job_id, within_s)

    def cancel_job(self, caller: Principal, request: pb.CancelJobRequest) -> Job:
        """Cancel a job."""
        return self._app.jobs.cancel(caller, request.job_id)

    def retry_job(self, caller: Principal, request: pb.RetryJobRequest) -> Job:
        """Queue a failed or canceled job again."""
        return self._app.jobs.retry(caller, request.job_id)

    async def watch_job(
        self, call: Call, caller: Principal, request: pb.WatchJobRequest
    ) -> AsyncIterator[Job]:
        """Stream a job until it has ended: as it is now, and whenever it has changed."""
        feed, metrics = call.gateway.feed, call.gateway.metrics
        after = await feed.newest()  # before the job is read, so that no change is missed
        job = await run_sync(self._app.jobs.get, caller, request.job_id)
        with feed.stream_limit.slot(caller.tenant_id), metrics.streams.track_inprogress():
            yield job
            if job.state.ended:
                return
            async for event in feed.follow(caller, job.scene_id, after):
                if event is not None and event.data.get("job_id") != job.id:
                    continue
                now = await run_sync(self._app.jobs.get, caller, job.id)  # raises when it was deleted
                if now != job:
                    yield now
                if now.state.ended:
                    return
                job = now
        raise stopping()
