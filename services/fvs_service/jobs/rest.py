"""Jobs over REST."""

from typing import Annotated

from fastapi import Depends, Query, Request, Response

from fvs_schema.jobs import Job, JobList, JobRequest
from fvs_service.gateway.job_wait import LONGEST_S, MOST_S, changed_job
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Counters,
    Feed,
    IdempotencyKey,
    JobId,
    JobPaging,
    SceneId,
    set_location,
    to_operate,
)
from fvs_service.gateway.rest.patience import while_connected
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1", "jobs")


@router.post("/scenes/{scene_id}/jobs", status_code=202)
def create_job(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    request: Annotated[JobRequest, Depends(json_body(JobRequest, to_operate))],
    response: Response,
    key: IdempotencyKey = None,
) -> Job:
    """Queue a job; while one of the same kind is queued in the scene, that one is returned."""
    job = app.jobs.create(caller, scene_id, request, key)
    set_location(response, f"/v1/jobs/{job.id}")
    return job


@router.get("/scenes/{scene_id}/jobs")
def list_jobs(app: App, caller: Caller, scene_id: SceneId, page: JobPaging) -> JobList:
    """List the jobs of a scene, the newest first."""
    return app.jobs.of_scene(caller, scene_id, page)


@router.post("/jobs/{job_id}:cancel", status_code=202)
def cancel_job(app: App, caller: Caller, job_id: JobId) -> Job:
    """Cancel a job; no effect when it has ended."""
    return app.jobs.cancel(caller, job_id)


@router.post("/jobs/{job_id}:retry", status_code=202)
def retry_job(app: App, caller: Caller, job_id: JobId) -> Job:
    """Queue a failed or canceled job again; finished stages are not repeated."""
    return app.jobs.retry(caller, job_id)


@router.get("/jobs/{job_id:plain}")
async def get_job(
    http: Request,
    app: App,
    feed: Feed,
    metrics: Counters,
    caller: Caller,
    job_id: JobId,
    wait_s: Annotated[
        float,
        Query(
            ge=0,
            le=MOST_S,
            allow_inf_nan=False,
            description="Wait until the job's state has changed, but not longer than this, nor than "
            f"{LONGEST_S:g} s. A job that has ended is returned at once.",
        ),
    ] = 0.0,
) -> Job:
    """Return a job and its progress, at once or when its state has changed."""
    return await while_connected(http, changed_job(app, feed, metrics, caller, job_id, wait_s))
