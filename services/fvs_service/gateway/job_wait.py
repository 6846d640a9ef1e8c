"""Long polling: a job once its state has changed. While a request waits it has no thread and no session."""

import asyncio
from contextlib import aclosing, suppress

from anyio.to_thread import run_sync

from fvs_schema.events import EventKind
from fvs_schema.jobs import Job
from fvs_service.application import Application
from fvs_service.events.feed import EventFeed
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics

MOST_S = 86_400
"""Maximum of what may be asked for."""
LONGEST_S = 30.0
"""Maximum of what is waited."""


async def changed_job(
    app: Application, feed: EventFeed, metrics: Metrics, caller: Principal, job_id: str, within_s: float
) -> Job:
    """The job as soon as its state differs from the present one; one that has ended at once.

    The job as it is after ``within_s``, and when the gateway stops. Raises ``NotFoundError``, also when the
    job is deleted meanwhile, and ``LimitExceededError`` as streams of events do.
    """
    within_s = min(within_s, LONGEST_S)
    after = await feed.newest() if within_s else 0  # before the job is read, so that no change is missed
    job = await run_sync(app.jobs.get, caller, job_id)
    if not within_s or job.state.ended:
        return job
    with (
        feed.stream_limit.slot(caller.tenant_id),
        metrics.streams.track_inprogress(),
        suppress(TimeoutError),
    ):
        async with (
            asyncio.timeout(within_s),
            aclosing(feed.follow(caller, job.scene_id, after)) as events,
        ):
            async for event in events:
                if event is None or event.data.get("job_id") != job_id:
                    continue
                if event.kind is not EventKind.JOB_PROGRESS:
                    changed = await run_sync(app.jobs.get, caller, job_id)
                    if changed.state is not job.state:
                        return changed
    return await run_sync(app.jobs.get, caller, job_id)
