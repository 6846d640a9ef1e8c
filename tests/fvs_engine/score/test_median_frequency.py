import math

import numpy as np
import pytest
import torch

from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore, MedianFrequency, rank
from fvs_engine.splat.device_memory import view_bytes
from fvs_engine.splat.raster import Rendering, create_rasterizer
from fvs_schema.candidates import CandidateStatus


@pytest.fixture(scope="module")
def rasterizer():
    return create_rasterizer("reference")


class Painted:
    """A rasteriser that returns one colour and one alpha everywhere."""

    name = "painted"
    device = torch.device("cpu")
    batch_bytes = 0

    def __init__(self, color: float, alpha: float) -> None:
        self.color, self.alpha = color, alpha

    def render(self, gaussians, camera, *_, **__) -> Rendering:
        size = (camera.height, camera.width)
        return Rendering(
            torch.full((*size, 3), self.color),
            torch.full(size, self.alpha),
            torch.zeros(size),
            torch.zeros(len(gaussians)),
            None,
        )


def test_a_score_is_the_definition_applied_to_the_render(ball, candidate_at, rasterizer):
    candidates = [candidate_at("near", (3, 0, 0)), candidate_at("side", (0, 4, 1))]
    scores = MedianFrequency().score(ball, candidates, rasterizer)
    for candidate, found in zip(candidates, scores, strict=True):
        rendering = rasterizer.render(ball, candidate.camera, candidate.camera_from_model)
        image = rendering.color.clamp(0, 1).double().numpy()
        expected = np.median(np.log(np.abs(np.fft.fft2(image, axes=(0, 1)))))
        assert found.name == candidate.name
        assert found.score == pytest.approx(expected, abs=1e-5)
        assert found.coverage == pytest.approx(float(rendering.alpha.mean()))
        assert found.status is CandidateStatus.RANKED


def test_looking_away_is_out_of_the_model_and_far_away_is_low_coverage(ball, candidate_at, rasterizer):
    away = candidate_at("away", (3, 0, 0), target=(9, 0, 0))
    far = candidate_at("far", (30, 0, 0))
    near = candidate_at("near", (3, 0, 0))
    scores = MedianFrequency().score(ball, [away, far, near], rasterizer)
    assert [score.status for score in scores] == ["out-of-model", "low-coverage", "ranked"]
    assert scores[0].score is None
    assert scores[0].coverage == 0
    assert math.isfinite(scores[1].score)
    assert scores[1].coverage < 0.1
    assert [(place.name, place.rank) for place in rank(scores)] == [
        ("near", 1),
        ("far", None),
        ("away", None),
    ]


@pytest.mark.parametrize(
    ("color", "alpha"), [(0.0, 0.0), (0.0, 1.0), (0.5, 1.0), (math.nan, 1.0), (0.5, math.nan)]
)
def test_no_number_that_is_not_finite_ever_leaves(ball, candidate_at, color, alpha):
    (score,) = MedianFrequency().score(ball, [candidate_at("a", (3, 0, 0))], Painted(color, alpha))
    assert score.score is None
    assert score.status is CandidateStatus.OUT_OF_MODEL
    assert math.isfinite(score.coverage)


def test_sizes_cannot_be_mixed(ball, candidate_at, rasterizer):
    small = PinholeCamera(24, 18, 20.0, 20.0, 12.0, 9.0)
    candidates = [candidate_at("a", (3, 0, 0)), candidate_at("b", (3, 0, 0), camera=small)]
    with pytest.raises(InvalidInputError, match="24 × 18, 48 × 36"):
        MedianFrequency().score(ball, candidates, rasterizer)


def test_no_candidates_give_no_scores(ball, rasterizer):
    assert MedianFrequency().score(ball, [], rasterizer) == ()


def test_progress_is_told_and_a_stop_is_obeyed(ball, candidate_at, rasterizer):
    candidates = [candidate_at(str(i), (3, 0, 0.1 * i)) for i in range(3)]
    reports = []
    monitor = Monitor(reports.append)
    MedianFrequency().score(ball, candidates, rasterizer, monitor=monitor)
    assert (reports[-1].stage, reports[-1].done, reports[-1].total) == ("score", 3, 3)
    monitor.cancel()
    with pytest.raises(Cancelled):
        MedianFrequency().score(ball, candidates, rasterizer, monitor=monitor)


def test_scoring_leaves_no_gradients_behind(ball, candidate_at, rasterizer):
    ball.requires_grad_()
    MedianFrequency().score(ball, [candidate_at("a", (3, 0, 0))], rasterizer)
    assert all(tensor.grad is None for tensor in ball.tensors().values())


def test_a_share_that_is_none_is_refused():
    with pytest.raises(InvalidInputError):
        MedianFrequency(min_coverage=1.5)


@pytest.mark.parametrize(
    ("score", "status", "coverage"),
    [
        (None, CandidateStatus.RANKED, 0.5),
        (1.0, CandidateStatus.OUT_OF_MODEL, 0.5),
        (math.inf, CandidateStatus.RANKED, 0.5),
        (math.nan, CandidateStatus.LOW_COVERAGE, 0.5),
        (1.0, CandidateStatus.RANKED, math.nan),
        (1.0, CandidateStatus.RANKED, 1.01),
    ],
)
def test_results_that_contradict_themselves_cannot_be_made(score, status, coverage):
    with pytest.raises(InvalidInputError):
        CandidateScore("a", score, status, coverage)


@pytest.mark.parametrize(("room", "sizes"), [(0, [1] * 5), (0.5, [1] * 5), (2.5, [2, 2, 1]), (9, [5])])
def test_so_many_views_are_scored_at_once_as_the_memory_allows(ball, candidate_at, monkeypatch, room, sizes):
    measured = []

    def measure(_, images):
        measured.append(len(images))
        return images.mean(dim=(1, 2, 3))

    monkeypatch.setattr(MedianFrequency, "measure", measure)
    candidates = [candidate_at(str(number), (3, 0, number)) for number in range(5)]
    painted, camera = Painted(0.5, 1.0), candidates[0].camera
    painted.batch_bytes = int(room * view_bytes(ball, camera.width, camera.height))
    scores = MedianFrequency().score(ball, candidates, painted)
    assert [score.name for score in scores] == [candidate.name for candidate in candidates]
    assert sorted(measured, reverse=True) == sizes
