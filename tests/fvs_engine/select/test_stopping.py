import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.plan.plan_records import Expectation, Forecast, Outlook
from fvs_engine.plan.reach import Reach
from fvs_engine.select.stopping import (
    Clock,
    budget_spent,
    gain_too_small,
    grounded,
    nothing_in_reach,
    quality_reached,
    time_is_up,
    too_far,
)

HERE = np.zeros(3)


def test_the_budget_counts_all_views() -> None:
    assert budget_spent(9, 10) is None
    reason = budget_spent(10, 10)
    assert reason is not None
    assert reason.kind == "budget"


def test_a_step_that_would_end_late_is_not_begun() -> None:
    clock = Clock(1_000.0)
    assert time_is_up(clock, 900.0) is None
    reason = time_is_up(clock, 1_001.0)
    assert reason is not None
    assert reason.kind == "time-limit"


def test_without_a_limit_there_is_always_time() -> None:
    assert time_is_up(Clock(None), 1e12) is None


def test_there_is_nothing_in_reach_when_all_was_visited() -> None:
    reason = nothing_in_reach(Reach(nearest=3), HERE, {})
    assert reason is not None
    assert reason.kind == "nothing-in-reach"


@given(st.floats(1e-6, 1e6))
def test_the_radius_that_it_advises_reaches_something(distance: float) -> None:
    unvisited = {"only": np.array([0.0, distance, 0.0])}
    reason = nothing_in_reach(Reach(radius=distance / 2), HERE, unvisited)
    assert reason is not None
    found = re.search(r"a radius of (\S+) would reach", reason.message)
    assert found is not None
    advised = float(found[1])
    assert nothing_in_reach(Reach(radius=advised), HERE, unvisited) is None
    assert advised == pytest.approx(distance, rel=0.02)


def outlook(now_db: float | None, gain_db: float | None) -> Outlook:
    forecast = None if now_db is None else Forecast(db=now_db, low_db=now_db - 1, high_db=now_db + 1)
    now = Expectation(variance=0.5, forecast=forecast)
    return Outlook(now=now, after_next=now, end=now, gain_db=gain_db)


def test_a_selection_ends_at_the_quality_or_the_gain_that_was_asked_for() -> None:
    reached, small = quality_reached(outlook(25.3, None), 25.0), gain_too_small(outlook(None, 0.04), 0.1)
    assert reached is not None
    assert small is not None
    assert (reached.kind, small.kind) == ("quality", "gain")
    assert "25.3 dB, 24.3 to 26.3" in reached.message
    assert quality_reached(outlook(24.9, None), 25.0) is None
    assert gain_too_small(outlook(None, 0.1), 0.1) is None


def test_without_a_forecast_or_a_wish_a_selection_goes_on() -> None:
    assert quality_reached(outlook(None, None), 25.0) is None
    assert quality_reached(outlook(99.0, None), None) is None
    assert gain_too_small(outlook(None, None), 0.1) is None
    assert gain_too_small(outlook(None, 0.0), None) is None


def test_the_travel_ends_before_the_view_that_exceeds_it() -> None:
    assert too_far("a", 2.0, 2.0) is None
    reason = too_far("a", 2.0, 1.5)
    assert reason is not None
    assert reason.kind == "travel"
    assert "a, is 2 away, and 1.5 is left" in reason.message


def test_a_vehicle_is_grounded_by_its_reach_or_by_what_is_left() -> None:
    unvisited = {"far": np.array([9.0, 0.0, 0.0]), "near": np.array([2.0, 0.0, 0.0])}
    assert grounded(Reach(nearest=3), 2.0, HERE, unvisited) is None
    kinds = [
        grounded(Reach(radius=1.0), 1.9, HERE, unvisited),
        grounded(Reach(radius=5.0), 1.9, HERE, unvisited),
        grounded(Reach(nearest=3), np.inf, HERE, {}),
    ]
    assert [reason and reason.kind for reason in kinds] == ["nothing-in-reach", "travel", "nothing-in-reach"]
    assert kinds[1] is not None
    assert "near, is 2 away" in kinds[1].message
    rounded = grounded(Reach(nearest=1), 1e-9, HERE, unvisited)
    assert rounded is not None
    assert rounded.message.endswith("and 0 is left.")
