"""How long the stages of jobs take, estimated from the service's own finished jobs."""

from collections.abc import Mapping, Sequence
from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_engine.records import Record
from fvs_schema.jobs import JobKind, JobState
from fvs_schema.stages import Stage
from fvs_service.jobs.stages import FIRST_IMAGES, JobSize, has_first_model, stage_of_job
from fvs_service.storage.tables import JobMilestoneRow, JobRow

TIMING = "timing"
"""The name of the milestone with a job's timing."""
_RECENT = 12


class JobTiming(Record):
    """A finished job: its size, and the seconds of each stage."""

    size: JobSize
    seconds: Mapping[Stage, float]


def past_timings(session: Session, kind: JobKind, first: bool) -> tuple[JobTiming, ...]:
    """The timings of the latest jobs of a kind, of scenes' first ones or of later ones."""
    rows = session.scalars(
        select(JobMilestoneRow.document)
        .join(JobRow, JobRow.id == JobMilestoneRow.job_id)
        .where(
            JobMilestoneRow.name == TIMING,
            JobRow.kind == kind.value,
            JobRow.state == JobState.SUCCEEDED.value,
        )
        .order_by(*JobRow.newest_first())
        .limit(2 * _RECENT)
    )
    timings = (JobTiming.model_validate(row) for row in rows)
    return tuple(timing for timing in timings if timing.size.first is first)[:_RECENT]


def expected_seconds(size: JobSize, past: Sequence[JobTiming]) -> Mapping[Stage, float]:
    """Expected time of each stage: the median over past jobs, each scaled to the size of this one."""
    stages = dict.fromkeys(stage for timing in past for stage in timing.seconds if stage != Stage.FIRST_MODEL)
    expected: dict[Stage, float] = {
        stage: median(
            timing.seconds.get(stage, 0.0) * _work(stage, size) / _work(stage, timing.size) for timing in past
        )
        for stage in stages
    }
    if has_first_model(first=size.first, images=size.images):
        expected[Stage.FIRST_MODEL] = _first_model_seconds(size, past)
    return expected


def _first_model_seconds(size: JobSize, past: Sequence[JobTiming]) -> float:
    """The median of past first models; without any, the time of an update of their images alone."""
    taken = [timing.seconds.get(Stage.FIRST_MODEL, 0.0) for timing in past]
    if any(taken):
        return median(seconds for seconds in taken if seconds > 0)
    alone = size.model_copy(update={"images": FIRST_IMAGES, "new": FIRST_IMAGES})
    expected = expected_seconds(alone, past)
    return sum(seconds for stage, seconds in expected.items() if stage_of_job(stage).first_model[1])


def _work(stage: Stage, size: JobSize) -> float:
    return max(stage_of_job(stage).work(size), 1e-6)
