"""Terms of a plan that the model tells."""

import pytest

from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor
from fvs_engine.plan.plan import make_plan
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget
from fvs_engine.score import MedianFrequencyEstimate, appearance
from fvs_engine.score.appearance import with_appearance
from fvs_engine.splat.raster import create_rasterizer
from fvs_schema.findings import Finding, FindingCode


@pytest.fixture
def candidates(candidate_at):
    return [
        candidate_at("near", (3, 0, 0)),
        candidate_at("side", (0, 4, 1)),
        candidate_at("away", (0, -4, 0), target=(0, -9, 0)),
    ]


@pytest.fixture
def plan(candidate_at, candidates):
    visited = [candidate_at("visited", (-3, 0, 0))]
    return make_plan(Targets(visited, candidates), Budget(2), [visited[0].centre])


def test_terms_say_what_the_model_shows(ball, candidates, plan):
    estimates = MedianFrequencyEstimate(0.0).score(ball, candidates, create_rasterizer("reference"))
    expected = {score.name: (score.score, score.coverage) for score in estimates}
    shown = with_appearance(plan, candidates, ball)
    assert {term.name: (term.median_frequency, term.coverage) for term in shown.terms} == expected
    assert expected["away"] == (None, 0.0)
    plain = [term.model_copy(update={"median_frequency": None, "coverage": None}) for term in shown.terms]
    assert plain == list(plan.terms)
    assert shown.tours == plan.tours


@pytest.mark.parametrize("views", [1, 2])
def test_planned_views_that_show_nothing_are_warned_of(ball, candidate_at, views):
    visited = [candidate_at("visited", (-3, 0, 0))]
    away = [candidate_at(f"{y}", (0, y, 0), target=(0, 3 * y, 0)) for y in (-4, 4)]
    planned = make_plan(Targets(visited, away), Budget(views), [visited[0].centre])
    assert with_appearance(planned, away, ball).warnings == (Finding.of(FindingCode.NOTHING_IN_VIEW),)


def test_planned_views_of_which_one_shows_the_model_are_not_warned_of(ball, candidates, plan):
    assert not with_appearance(plan, candidates, ball).warnings


def test_only_the_first_terms_are_completed(ball, candidates, plan, monkeypatch):
    monkeypatch.setattr(appearance, "MOST_SHOWN", 1)
    first, *rest = with_appearance(plan, candidates, ball).terms
    assert first.coverage is not None
    assert [term.coverage for term in rest] == [None, None]


def test_it_can_be_stopped(ball, candidates, plan):
    monitor = Monitor()
    monitor.cancel()
    with pytest.raises(Cancelled):
        with_appearance(plan, candidates, ball, monitor)
