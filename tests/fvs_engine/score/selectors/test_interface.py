from dataclasses import dataclass

import pytest
import torch

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.baselines import SELECTORS, create_selector
from fvs_engine.score import CandidateScore
from fvs_engine.score.selectors.interface import select
from fvs_engine.splat.raster import create_rasterizer
from fvs_schema.candidates import CandidateStatus


@dataclass
class FixedScores:
    """A selector that returns given scores."""

    answers: dict[str, tuple[float | None, CandidateStatus]]
    name: str = "fixed"

    def score(self, context, monitor=None):  # noqa: ARG002 - what every selector takes
        return tuple(CandidateScore(c.name, *self.answers[c.name], 0.5) for c in context.candidates)


def ranked(**scores):
    return {name: (score, CandidateStatus.RANKED) for name, score in scores.items()}


@pytest.fixture
def views(view_at):
    return {name: view_at(name, (x, 3, 0)) for name, x in [("a", 0), ("b", 1), ("c", 9), ("d", 2)]}


def test_the_lowest_score_is_chosen_and_ties_go_to_the_nearest(context, views):
    here = context([views["a"]], [views["b"], views["c"], views["d"]])
    selection = select(here, FixedScores(ranked(b=1.0, c=0.5, d=0.5)), {"b": 1.0, "c": 9.0, "d": 2.0})
    assert selection.chosen == "d"
    assert selection.fallback is None
    assert [place.name for place in selection.ranked] == ["d", "c", "b"]


def test_low_coverage_is_taken_only_when_nothing_is_ranked(context, views):
    here = context([views["a"]], [views["b"], views["c"], views["d"]])
    low, out = CandidateStatus.LOW_COVERAGE, CandidateStatus.OUT_OF_MODEL
    answers = {"b": (5.0, low), "c": (4.0, low), "d": (9.0, CandidateStatus.RANKED)}
    assert select(here, FixedScores(answers), {}).chosen == "d"
    selection = select(here, FixedScores({**answers, "d": (None, out)}), {})
    assert (selection.chosen, selection.fallback) == ("c", "low-coverage")


def test_without_any_score_the_farthest_view_is_taken(context, views):
    out = (None, CandidateStatus.OUT_OF_MODEL)
    here = context([views["a"]], [views["b"], views["c"], views["d"]])
    selection = select(here, FixedScores({"b": out, "c": out, "d": out}), {})
    assert (selection.chosen, selection.fallback) == ("c", "farthest")
    assert all(place.score is None for place in selection.ranked)


def test_torch_s_threads_do_not_get_in_the_way_of_the_kernels(context, views):
    before, during = torch.get_num_threads(), []

    class Counting(FixedScores):
        def score(self, context, monitor=None):
            during.append(torch.get_num_threads())
            return super().score(context, monitor)

    torch.set_num_threads(2)
    try:
        select(context([views["a"]], [views["b"]]), Counting(ranked(b=1.0)), {})
        assert during == [1]
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_nothing_to_choose_from_is_an_error(context, views):
    with pytest.raises(InvalidInputError, match="no candidate"):
        select(context([views["a"]], []), FixedScores({}), {})


def test_contexts_that_contradict_themselves_cannot_be_made(context, views):
    with pytest.raises(InvalidInputError, match="more than once"):
        context([views["a"]], [views["b"], views["a"]])
    with pytest.raises(InvalidInputError, match="order of capture"):
        context([views["a"]], [views["b"]], order={"a": 0})


def test_the_table_knows_all_names_and_says_so():
    assert set(SELECTORS) == {
        "median-frequency", "median-frequency-fast", "median-frequency-estimate", "random", "uniform",
        "farthest", "nearest", "kriging", "fisher", "d-optimal", "coverage", "spectral-median",
    }  # fmt: skip
    assert all(create_selector(name).name == name for name in SELECTORS)
    with pytest.raises(InvalidInputError, match=r"'best'.*median-frequency.*d-optimal"):
        create_selector("best")


@pytest.mark.parametrize("name", SELECTORS)
def test_all_selectors_repeat_themselves_whatever_the_order_of_the_candidates(context, ring, ball, name):
    visited, candidates = ring(0, 20), ring(60, 100, 180, 250)
    order = {view.name: place for place, view in enumerate([*visited, *candidates])}
    scores = create_selector(name).score(context(visited, candidates, order=order))
    again = create_selector(name).score(context(visited, candidates[::-1], order=order))
    assert scores == again[::-1]
    assert [score.name for score in scores] == [view.name for view in candidates]
    assert all(score.status is CandidateStatus.RANKED for score in scores)
    assert all(tensor.grad is None and not tensor.requires_grad for tensor in ball.tensors().values())


@pytest.mark.parametrize("backend", ["reference", pytest.param("gsplat", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("name", SELECTORS)
def test_all_selectors_need_no_more_of_a_rasteriser_than_its_interface(context, ring, ball, backend, name):
    rasterizer = create_rasterizer(backend)
    visited, candidates = ring(0, 20, 40), ring(60, 180)
    here = context(visited, candidates, gaussians=ball.to(rasterizer.device), rasterizer=rasterizer)
    selection = select(here, create_selector(name), {})
    assert selection.fallback is None
    assert {place.status for place in selection.ranked} == {CandidateStatus.RANKED}
    if name in {"fisher", "d-optimal", "coverage", "farthest"}:
        assert selection.chosen == "180"  # the side that nobody has seen


@pytest.mark.parametrize("name", SELECTORS)
def test_views_of_nothing_never_have_a_number_that_is_not_finite(context, ring, view_at, name):
    blank = view_at("blank", (3, 0, 0), target=(9, 0, 0))
    here = context(ring(0, 30), [blank, *ring(90)])
    void, seen = create_selector(name).score(here)
    if name in {"random", "uniform", "farthest", "nearest", "kriging"}:  # these render nothing
        assert void.coverage is None
        assert void.status is CandidateStatus.RANKED
    else:
        assert void.coverage == 0
        assert void.status is CandidateStatus.OUT_OF_MODEL
        assert void.score is None
    assert seen.status is CandidateStatus.RANKED
    assert select(context(ring(0, 30), [blank]), create_selector(name), {}).chosen == "blank"
