"""The progress of a job and its remaining time: what its stages usually take, corrected by what they took."""

import math
import time
from collections.abc import Callable, Mapping, Sequence

from fvs_engine.images.pixels import reduced_size
from fvs_schema.images import Image, Registration
from fvs_schema.jobs import Job, JobKind
from fvs_schema.stages import Stage
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.jobs.stages import JobSize, stage_of_job
from fvs_service.jobs.timing import JobTiming, expected_seconds
from fvs_service.settings import WorkerSettings

_ORDER = tuple(Stage)
_MEGAPIXEL = 1e6
_OWN_TRUST, _FOREIGN_TRUST = 0.05, 0.01
"""Weight of the usual speed against the measured one, as a share of the job: less where the
usual speed is another machine's."""
_RATE_TRUST = 0.2
"""Share of a stage after which its present rate and its usual time weigh the same."""
_TRAIN_POWER = 1.25
"""Iterations slow down as Gaussians are added: a share s of them takes s to this power of the time."""
_OVERDUE = 0.15
"""A stage that exceeds its usual time is expected to last for this share of its time so far."""
_SMOOTHING = 0.1
_LEAST_SMOOTHING_S = 1.0
_LEAST_KNOWN = 0.03
"""Share of the usual time that a job must have run before a service without history gives an estimate."""
_LEAST_TRAINED_S = 5.0
"""Or the time that it must have trained: then the speed of its own iterations is known."""


def size_of(job: Job, images: Sequence[Image], first: bool, settings: WorkerSettings) -> JobSize:
    """The size of a job on ``images``; ``first`` is whether the scene has no model yet."""
    fine = job.kind is JobKind.FINE
    known = (Registration.REGISTERED, Registration.UNREGISTERED)
    new = len(images) if first or fine else sum(image.registration not in known for image in images)
    side = job.request.long_side_px or settings.long_side_px
    areas, reduced = [0.0], [0.0]
    for image in images:
        width, height = image.width_px or side, image.height_px or side
        areas.append(width * height / _MEGAPIXEL)
        small = reduced_size(width, height, side)
        reduced.append(small[0] * small[1] / _MEGAPIXEL)
    if fine:
        iterations = job.request.iterations or settings.fine_iterations
    else:
        usual = max(settings.initial_iterations, settings.iterations_per_image * len(images))
        iterations = job.request.iterations or usual
    return JobSize(
        first=first,
        images=len(images),
        new=new,
        megapixels=sum(areas) / max(1, len(images)),
        train_megapixels=sum(reduced) / max(1, len(images)),
        iterations=iterations,
    )


class JobProgress:
    """The progress of an attempt since one of its starts, and an estimate of the remaining time.

    ``past`` are finished jobs like it, of any size; ``resumed``: an earlier start has done a part of it.
    """

    def __init__(
        self,
        kind: JobKind,
        size: JobSize,
        past: Sequence[JobTiming],
        *,
        resumed: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._kind = kind
        self.reached = 0.0
        """In [0, 1]; it never falls."""
        self._own = bool(past)
        self._expected = expected_seconds(size, past or _TYPICAL[kind, size.first])
        self._clock = clock
        self._size = size
        self._seen = self._smoothed_at = clock()
        self._stage, self._share, self._share_at_start = Stage.START, 0.0, 0.0
        self._seconds: dict[Stage, float] = {Stage.START: 0.0}
        self._end: float | None = None
        self._resumed = resumed

    def add(self, progress: StageProgress) -> float | None:
        """Record a stage's progress; returns the remaining time in seconds, None while unknown."""
        self._elapse()
        stage = stage_of_job(progress.stage)
        share = 0.0 if progress.share is None else min(1.0, max(0.0, progress.share))
        start, end = stage.part_of(self._kind)
        self.reached = max(self.reached, start + share * (end - start))
        if stage.trains:
            share **= _TRAIN_POWER
        if progress.stage != self._stage:
            self._stage, self._share_at_start = progress.stage, share if share < 1 else 0.0
            self._seconds.setdefault(progress.stage, 0.0)
            if self._resumed and self._share_at_start > 0:
                self._end = None  # it resumes where an earlier start stopped: no reason to approach slowly
        self._share = share
        return self.now()

    @property
    def _usual_in_stage_s(self) -> float:
        """The usual time of the whole stage."""
        return self._expected.get(self._stage, 0.0)

    def now(self) -> float | None:
        """The remaining time now, also when no progress is reported for a while."""
        self._elapse()
        speed, known = self._slowness()
        if not self._own and known < _LEAST_KNOWN and not self._shows_its_rate():
            return None
        left_s = self._left_in_stage_s(speed) + speed * self._later_s()
        return self._smoothed(left_s)

    def _shows_its_rate(self) -> bool:
        trained_s = self._seconds.get(self._stage, 0.0)
        return (
            stage_of_job(self._stage).trains
            and self._share > self._share_at_start
            and trained_s >= _LEAST_TRAINED_S
        )

    def finished(self) -> JobTiming | None:
        """The job's timing, once it is committed; None when an earlier start has done a part of it."""
        self._elapse()
        return None if self._resumed else JobTiming(size=self._size, seconds=dict(self._seconds))

    def _elapse(self) -> None:
        now = self._clock()
        self._seconds[self._stage] += now - self._seen
        self._seen = now

    def _slowness(self) -> tuple[float, float]:
        """The job's time relative to the usual one, and the share of the usual time that it rests on."""
        usual = taken = 0.0
        for stage, seconds in self._seconds.items():
            if self._resumed and not stage_of_job(stage).trains:
                continue  # it may have been done before, and take no time now
            expected = self._expected.get(stage, 0.0)
            if stage == self._stage:
                expected = self._usual_in_stage_s * (self._share - self._share_at_start)
            if expected > 0:
                usual, taken = usual + expected, taken + seconds
        total = sum(self._expected.values()) or 1.0
        trust = total * (_OWN_TRUST if self._own else _FOREIGN_TRUST)
        return (taken + trust) / (usual + trust), usual / total

    def _left_in_stage_s(self, slowness: float) -> float:
        seconds, expected = self._seconds[self._stage], slowness * self._usual_in_stage_s
        done = self._share - self._share_at_start
        if self._share >= 1:
            return 0.0
        if done <= 0:
            return max(expected * (1 - self._share) - seconds, _OVERDUE * seconds)
        by_rate = seconds * (1 - self._share) / done
        weight = done / (done + _RATE_TRUST) if expected else 1.0
        return weight * by_rate + (1 - weight) * expected * (1 - self._share)

    def _later_s(self) -> float:
        """The usual time of the stages that are still to come."""
        reached = max(map(_ORDER.index, self._seconds))
        return sum(self._expected.get(stage, 0.0) for stage in _ORDER[reached + 1 :])

    def _smoothed(self, left_s: float) -> float:
        """The remaining time, smoothed; it stays within a tenth of the estimate."""
        now = self._seen
        if self._end is None:
            self._end = now + left_s
        over_s = max(_LEAST_SMOOTHING_S, _SMOOTHING * left_s)
        followed = 1 - math.exp(-(now - self._smoothed_at) / over_s)
        self._end += followed * (now + left_s - self._end)
        self._smoothed_at = now
        return max(0.0, self._end - now)


def _typical(images: int, new: int, iterations: int, seconds: Mapping[Stage, float]) -> JobTiming:
    size = JobSize(
        first=images == new,
        images=images,
        new=new,
        megapixels=0.23,
        train_megapixels=0.032,
        iterations=iterations,
    )
    return JobTiming(size=size, seconds=seconds)


_FIRST_UPDATE = {
    Stage.START: 0.2,
    Stage.NORMALISE: 1.8,
    Stage.FEATURES: 23.1,
    Stage.MATCHING: 7.6,
    Stage.INCREMENTAL_MAPPING: 12.3,
    Stage.EVIDENCE: 4.2,
    Stage.LOAD: 4.4,
    Stage.TRAINING: 14.5,
    Stage.SNAPSHOT: 0.5,
}
_LATER_UPDATE = {
    Stage.START: 0.2,
    Stage.NORMALISE: 1.4,
    Stage.FEATURES: 8.5,
    Stage.MATCHING: 5.9,
    Stage.REGISTRATION: 9.8,
    Stage.LOAD: 1.5,
    Stage.EVALUATE: 0.2,
    Stage.TRAINING: 4.7,
    Stage.SNAPSHOT: 0.5,
}
_FRAMES = {Stage.START: 0.5, Stage.FRAMES: 60.0}
_FINE = {Stage.START: 0.5, Stage.LOAD: 1.6, Stage.TRAINING: 71.5, Stage.SNAPSHOT: 1.0}
_TYPICAL: Mapping[tuple[JobKind, bool], Sequence[JobTiming]] = {
    (JobKind.UPDATE, True): (_typical(8, 8, 300, _FIRST_UPDATE),),
    (JobKind.UPDATE, False): (_typical(10, 2, 50, _LATER_UPDATE),),
    (JobKind.FINE, False): (_typical(10, 2, 600, _FINE),),
    (JobKind.FRAMES, False): (_typical(2, 1, 1, _FRAMES),),
}
"""Jobs of the scene fox on two busy cores, for services without finished jobs of their own."""
