"""The progress and the remaining time of jobs whose stages take what the test says."""

import itertools
from collections.abc import Iterator

import pytest
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.worker.progress import JobProgress
from fvs_service.jobs.stages import JobSize
from fvs_service.jobs.timing import JobTiming, expected_seconds

from fvs_schema.jobs import JobKind
from fvs_schema.stages import Stage

_SIZE = JobSize(first=True, images=10, new=10, megapixels=1.0, train_megapixels=0.1, iterations=1000)
_USUAL = {
    Stage.START: 1.0,
    "features": 20.0,
    "matching": 10.0,
    "load": 1.0,
    "training": 60.0,
    Stage.COMMIT: 2.0,
}


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def _life(remaining: JobProgress, clock: Clock, seconds: dict[str, float]) -> Iterator[tuple[float, float]]:
    """The time left and its estimate, twice a second through a job."""
    end = clock.now_s + sum(seconds.values())
    for stage, took in seconds.items():
        steps = max(1, round(2 * took))
        for step in range(steps):
            if stage == Stage.START:
                estimate = remaining.now()
            else:
                share = step / steps  # of the time; iterations get slower as Gaussians are added
                share = share**0.8 if stage == "training" else share
                estimate = remaining.add(StageProgress(stage=stage, share=share))
            if estimate is not None:
                yield end - clock.now_s, estimate
            clock.now_s += took / steps


def _errors(past: tuple[JobTiming, ...], seconds: dict[str, float], size: JobSize = _SIZE) -> list[float]:
    clock = Clock()
    total = sum(seconds.values())
    remaining = JobProgress(JobKind.UPDATE, size, past, clock=clock)
    said = [(left, estimate) for left, estimate in _life(remaining, clock, seconds) if left < 0.9 * total]
    return [abs(estimate - left) / left for left, estimate in said if left > 1]


_PAST = (JobTiming(size=_SIZE, seconds=_USUAL),)


def test_a_job_like_the_last_one_is_foretold() -> None:
    assert max(_errors(_PAST, _USUAL)) < 0.05


def test_a_first_model_is_foretold_from_jobs_without_one() -> None:
    """Ten images take the time that they took alone; then all take what is usual for their number."""
    usual = {**_USUAL, "quick-training": 12.0}
    size = _SIZE.model_copy(update={"images": 50, "new": 50})
    past = (JobTiming(size=_SIZE, seconds=usual),)
    expected = expected_seconds(size, past)
    assert expected[Stage.FIRST_MODEL] == 20.0 + 10.0 + 1.0 + 12.0
    assert Stage.FIRST_MODEL not in expected_seconds(_SIZE, past)
    assert Stage.FIRST_MODEL not in expected_seconds(size.model_copy(update={"first": False}), past)
    stages = (
        Stage.START,
        Stage.FIRST_MODEL,
        "features",
        "matching",
        "load",
        "quick-training",
        "training",
        Stage.COMMIT,
    )
    seconds = {stage: expected[stage] for stage in stages}
    for slower in (0.5, 1.0, 2.0):
        errors = sorted(_errors(past, {stage: slower * each for stage, each in seconds.items()}, size))
        assert errors[len(errors) // 2] < 0.3
    with_one = JobTiming(size=size, seconds={**seconds, Stage.FIRST_MODEL: 30.0})
    assert expected_seconds(size, (*past, with_one))[Stage.FIRST_MODEL] == 30.0


@pytest.mark.parametrize("times", [0.3, 3.0])
def test_a_faster_or_slower_machine_is_noticed(times: float) -> None:
    errors = sorted(_errors(_PAST, {stage: times * seconds for stage, seconds in _USUAL.items()}))
    assert errors[len(errors) // 2] < 0.3  # the goal


def test_one_stage_that_takes_long_does_not_make_the_end_jump() -> None:
    clock = Clock()
    remaining = JobProgress(JobKind.UPDATE, _SIZE, _PAST, clock=clock)
    said = list(_life(remaining, clock, {**_USUAL, "matching": 40.0}))
    total = sum(_USUAL.values()) + 30
    ends = [total - left + estimate for left, estimate in said]
    assert max(abs(later - earlier) for earlier, later in itertools.pairwise(ends)) < 0.1 * total


def test_the_estimate_falls_in_a_stage_that_says_nothing() -> None:
    clock = Clock()
    remaining = JobProgress(JobKind.UPDATE, _SIZE, _PAST, clock=clock)
    first = remaining.add(StageProgress(stage="training", share=None))
    clock.now_s += 30
    later = remaining.now()
    assert first is not None
    assert later is not None
    assert first - 35 < later < first - 20


def test_a_resumed_job_is_not_thought_to_be_fast() -> None:
    clock = Clock()
    remaining = JobProgress(JobKind.UPDATE, _SIZE, _PAST, resumed=True, clock=clock)
    for stage in ("features", "matching", "load"):
        remaining.add(StageProgress(stage=stage, share=1.0))
        clock.now_s += 0.1
    estimate = remaining.add(StageProgress(stage="training", share=0.5))
    assert estimate is not None
    assert 28 < estimate < 40
    assert remaining.finished() is None


def test_without_past_jobs_nothing_is_said_at_first() -> None:
    clock = Clock()
    remaining = JobProgress(JobKind.FINE, _SIZE.model_copy(update={"first": False}), (), clock=clock)
    assert remaining.now() is None
    remaining.add(StageProgress(stage="training", share=0.0))
    clock.now_s += 10
    estimate = remaining.add(StageProgress(stage="training", share=0.5))
    assert estimate is not None
    assert 5 < estimate < 20


@pytest.mark.parametrize("resumed", [False, True])
def test_without_past_jobs_a_long_training_is_estimated_soon(resumed: bool) -> None:
    clock, started = Clock(), 0.02 if resumed else 0.0
    size = _SIZE.model_copy(update={"iterations": 100_000})
    remaining = JobProgress(JobKind.UPDATE, size, (), resumed=resumed, clock=clock)
    remaining.add(StageProgress(stage="training", share=started))
    for second in range(1, 11):
        clock.now_s += 1.0
        estimate = remaining.add(StageProgress(stage="training", share=started + 2e-4 * second))
    assert estimate is not None
    assert estimate > 10 * 60  # at this rate it takes more than an hour


def test_the_time_of_a_stage_is_scaled_by_its_work() -> None:
    twice = _SIZE.model_copy(update={"images": 20, "new": 20, "iterations": 500})
    expected = expected_seconds(twice, _PAST)
    assert expected["features"] == pytest.approx(40)
    assert expected["matching"] == pytest.approx(40)
    assert expected["training"] == pytest.approx(30)
    assert expected[Stage.START] == 1.0


def test_a_stage_that_most_jobs_skip_is_not_expected() -> None:
    compiled = JobTiming(size=_SIZE, seconds={**_USUAL, "compile": 100.0})
    assert expected_seconds(_SIZE, (compiled, *_PAST, *_PAST))["compile"] == 0


def test_what_a_job_took_is_known_by_stage() -> None:
    clock = Clock()
    remaining = JobProgress(JobKind.UPDATE, _SIZE, (), clock=clock)
    list(_life(remaining, clock, _USUAL))
    timing = remaining.finished()
    assert timing is not None
    assert timing.size == _SIZE
    assert timing.seconds == pytest.approx(_USUAL)


@pytest.mark.parametrize("kind", JobKind)
def test_progress_never_falls_and_reaches_the_end(kind: JobKind) -> None:
    progress, reached = JobProgress(kind, _SIZE.model_copy(update={"first": False}), ()), [0.0]
    stages = ("frames", "images", "first-model", "features", "matching", "incremental-mapping")
    later = ("global-mapping", "score", "load", "quick-training", "quick-snapshot", "training", "snapshot")
    for stage in (*stages, *later):
        for share in (0.0, 0.5, 1.0, None):
            progress.add(StageProgress(stage=stage, share=share))
            reached.append(progress.reached)
    assert all(later >= earlier for earlier, later in itertools.pairwise(reached))
    assert reached[-1] == 1.0
