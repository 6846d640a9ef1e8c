"""The first candidates, exactly, without rendering all of them."""

import math

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from fvs_engine.candidates import CandidateScore
from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.score import MedianFrequency, MedianFrequencyFast, rank
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus

CAMERA = PinholeCamera(64, 48, 55.0, 55.0, 32.0, 24.0)


@pytest.fixture(scope="module")
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.fixture(scope="module")
def scene() -> tuple[Gaussians, list[PinholeView]]:
    """A globe whose splats grow from one side to the other, and 240 views around it; some look away."""
    draw = np.random.default_rng(7)
    count = 3_000
    directions = draw.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = 0.02 + 0.05 * (1 + directions[:, :1]) + draw.uniform(0, 0.01, (count, 3))
    values = (
        directions,
        np.log(sizes),
        draw.normal(size=(count, 4)),
        np.full(count, 2.0),
        draw.normal(scale=0.6, size=(count, 3)),
        np.zeros((count, 0, 3)),
    )
    views = []
    for n in range(240):
        angle, height = 2 * math.pi * (n % 80) / 80, (n // 80) - 1.0
        eye = np.array([2.6 * math.cos(angle), 2.6 * math.sin(angle), height])
        target = 3 * eye if n % 40 == 39 else 0 * eye
        views.append(PinholeView(f"{n:03}", CAMERA, look_at(eye, target, (0.0, 0.0, 1.0)).inverse()))
    return Gaussians(*(torch.from_numpy(value.astype(np.float32)) for value in values)), views


@pytest.fixture(scope="module")
def exactly(scene: tuple[Gaussians, list[PinholeView]], cpu: Rasterizer) -> tuple[CandidateScore, ...]:
    """The scores of all views, computed from their renders."""
    gaussians, views = scene
    return tuple(MedianFrequency().score(gaussians, views, cpu))


def test_the_first_ones_are_those_of_the_exact_ranking(scene, cpu, exactly):
    gaussians, views = scene
    exact = {score.name: score for score in exactly}
    found = MedianFrequencyFast(first=5).score(gaussians, views, cpu)
    assert [score.name for score in found] == [view.name for view in views]
    ranking = rank(found)
    assert [place.name for place in ranking[:5]] == [place.name for place in rank(exact.values())[:5]]
    assert not any(place.estimated for place in ranking[:5])
    measured = [score for score in found if not score.estimated]
    assert 5 <= len(measured) < 80
    for score in measured:
        assert score == exact[score.name]
    errors = [score.score - exact[score.name].score for score in found if score.estimated and score.score]
    values = [score.score for score in exact.values() if score.score is not None]
    assert np.std(errors) < 0.5 * np.std(values)  # predictions are on the scale of the scores


def test_scores_are_passed_on_once_and_progress_is_that_of_the_estimates(scene, cpu):
    gaussians, views = scene
    passed: list[CandidateScore] = []
    stages: list[Progress] = []
    monitor = Monitor(on_progress=stages.append, on_results=passed.extend)
    scores = MedianFrequencyFast(first=5).score(gaussians, views, cpu, monitor=monitor)
    assert sorted(passed, key=lambda score: score.name) == list(scores)
    estimated = [report.done for report in stages if report.stage == "estimate"]
    assert estimated == list(range(1, 241))


def test_linear_algebra_has_one_thread_between_renders(scene, cpu):
    """Others would keep cores busy, waiting, while views are rendered."""

    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    meanwhile: list[set[int]] = []
    monitor = Monitor(on_results=lambda _: meanwhile.append(threads()))
    with threadpool_limits(2, "blas"):
        MedianFrequencyFast(first=5).score(*scene, cpu, monitor=monitor)
        after = threads()
    assert meanwhile[0] == {1}
    assert after == {2}


def test_few_candidates_are_all_exact(scene, cpu):
    gaussians, views = scene
    found = MedianFrequencyFast().score(gaussians, views[:40], cpu)
    assert found == MedianFrequency().score(gaussians, views[:40], cpu)


def test_views_that_show_too_little_are_not_rendered(scene, cpu):
    gaussians, views = scene
    away = [view for n, view in enumerate(views) if n % 40 == 39]
    found = {score.name: score for score in MedianFrequencyFast(first=5).score(gaussians, views, cpu)}
    for view in away:
        assert found[view.name].status is CandidateStatus.OUT_OF_MODEL
        assert found[view.name].estimated


def test_a_candidate_of_low_coverage_is_none_of_the_first(scene, cpu, exactly):
    """With a least coverage that most views miss."""
    gaussians, views = scene
    coverages = [score.coverage for score in exactly]
    least = float(np.quantile(coverages, 0.7))
    exact = rank(MedianFrequency(least).score(gaussians, views, cpu))
    found = rank(MedianFrequencyFast(first=5, min_coverage=least).score(gaussians, views, cpu))
    assert [place.name for place in found[:5]] == [place.name for place in exact[:5]]


def test_it_can_be_stopped_between_views(scene, cpu):
    gaussians, views = scene
    monitor = Monitor()
    seen: list[CandidateScore] = []

    def stop(results):
        seen.extend(results)
        monitor.cancel()

    monitor._on_results = stop
    with pytest.raises(Cancelled):
        MedianFrequencyFast(first=5).score(gaussians, views, cpu, monitor=monitor)
    assert 0 < len(seen) < 20


def test_no_first_candidates_is_an_error():
    with pytest.raises(InvalidInputError, match="1 or more"):
        MedianFrequencyFast(first=0)
