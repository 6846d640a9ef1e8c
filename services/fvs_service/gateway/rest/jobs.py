"""Jobs over REST."""

from typing import Annotated

from fastapi import Depends, Response

from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    IdempotencyKey,
    JobId,
    JobPaging,
    SceneId,
    set_location,
    to_operate,
)
from fvs_service.gateway.rest.routing import json_router
from fvs_service.jobs.model import Job, JobList, JobRequest

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
def get_job(app: App, caller: Caller, job_id: JobId) -> Job:
    """Return a job and its progress."""
    return app.jobs.get(caller, job_id)
