"""How long the stages of jobs take, estimated from the service's own finished jobs."""

from collections.abc import Callable, Mapping, Sequence
from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_engine.records import Record
from fvs_service.jobs.first_model import FIRST_IMAGES, FIRST_MODEL, PARTS, has_first_model
from fvs_service.jobs.model import JobKind, JobState
from fvs_service.storage.tables import JobRow, JobStageRow

TIMING_STAGE = "timing"
"""The name under which a job's timing is recorded among its finished stages."""
_RECENT = 12


class JobSize(Record):
    """What a job's time depends on: images in all and new ones, their megapixels, those trained on."""

    first: bool
    images: int
    new: int
    megapixels: float
    train_megapixels: float
    iterations: int


class JobTiming(Record):
    """A finished job: its size, and the seconds of each stage."""

    size: JobSize
    seconds: Mapping[str, float]


def past_timings(session: Session, kind: JobKind, first: bool) -> tuple[JobTiming, ...]:
    """The timings of the latest jobs of a kind, of scenes' first ones or of later ones."""
    rows = session.scalars(
        select(JobStageRow.document)
        .join(JobRow, JobRow.id == JobStageRow.job_id)
        .where(
            JobStageRow.name == TIMING_STAGE,
            JobRow.kind == kind.value,
            JobRow.state == JobState.SUCCEEDED.value,
        )
        .order_by(*JobRow.newest_first())
        .limit(2 * _RECENT)
    )
    timings = (JobTiming.model_validate(row) for row in rows)
    return tuple(timing for timing in timings if timing.size.first is first)[:_RECENT]


def expected_seconds(size: JobSize, past: Sequence[JobTiming]) -> Mapping[str, float]:
    """Expected time of each stage: the median over past jobs, each scaled to the size of this one."""
    stages = dict.fromkeys(stage for timing in past for stage in timing.seconds if stage != FIRST_MODEL)
    expected = {
        stage: median(
            timing.seconds.get(stage, 0.0) * _work(stage, size) / _work(stage, timing.size) for timing in past
        )
        for stage in stages
    }
    if has_first_model(first=size.first, images=size.images):
        expected[FIRST_MODEL] = _first_model_seconds(size, past)
    return expected


def _first_model_seconds(size: JobSize, past: Sequence[JobTiming]) -> float:
    """The median of past first models; without any, the time of an update of their images alone."""
    taken = [timing.seconds[FIRST_MODEL] for timing in past if timing.seconds.get(FIRST_MODEL, 0.0) > 0]
    if taken:
        return median(taken)
    alone = size.model_copy(update={"images": FIRST_IMAGES, "new": FIRST_IMAGES})
    return sum(seconds for stage, seconds in expected_seconds(alone, past).items() if stage in PARTS)


def _work(stage: str, size: JobSize) -> float:
    return max(_WORK.get(stage, _per_image)(size), 1e-6)


def _per_image(size: JobSize) -> float:
    return float(size.images)


def _per_new_pixel(size: JobSize) -> float:
    return size.new * size.megapixels


def _per_pair(size: JobSize) -> float:
    return float(size.new * size.images)


def _per_training_pixel(size: JobSize) -> float:
    return size.iterations * size.train_megapixels


_WORK: Mapping[str, Callable[[JobSize], float]] = {
    "start": lambda _size: 1.0,
    "images": _per_new_pixel,
    "normalise": _per_new_pixel,
    "compile": lambda _size: 1.0,
    "features": _per_new_pixel,
    "pairs": _per_pair,
    "matching": _per_pair,
    "registration": lambda size: float(size.new),
    "localisation": lambda size: float(size.new),
    "quick training": _per_training_pixel,
    "train": _per_training_pixel,
}
"""What the time of a stage is proportional to; for stages not listed, the number of images."""
