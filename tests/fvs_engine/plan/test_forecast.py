"""Forecasts of PSNR against the line that made the data."""

import numpy as np
import pytest

from fvs_engine.plan.forecast import PsnrForecast, Seen
from fvs_engine.plan.plan_records import COVERAGE


def photographs(count: int, seed: int, level: float = 33.0, slope: float = 24.0) -> list[Seen]:
    draw = np.random.default_rng(seed)
    variances = draw.uniform(0.2, 0.8, count)
    return [Seen(v, level - slope * v + draw.normal(0.0, 2.0)) for v in variances.tolist()]


def test_many_photographs_give_their_own_line():
    forecast = PsnrForecast(photographs(3_000, 0, level=30.0, slope=12.0))
    for variance in (0.2, 0.5, 0.8):
        assert forecast.at(variance).db == pytest.approx(30.0 - 12.0 * variance, abs=0.3)
    assert forecast.gain_db(0.5, 0.4) == pytest.approx(1.2, abs=0.1)


def test_few_photographs_near_each_other_keep_the_slope_of_other_scenes():
    seen = [Seen(0.6, 18.0), Seen(0.601, 18.4), Seen(0.602, 17.9)]
    forecast = PsnrForecast(seen)
    assert forecast.at(0.6).db == pytest.approx(18.1, abs=0.5)
    assert 15.0 < forecast.gain_db(1.0, 0.0) < 35.0


def test_the_interval_holds_what_it_says():
    """The mean over targets, from which the mean of chosen views differs by 2.5 dB, either way."""
    held = 0
    for seed in range(400):
        draw = np.random.default_rng(seed)
        seen = photographs(8, seed + 1_000)
        truth = 33.0 - 24.0 * 0.35 + draw.normal(0.0, 2.5)
        found = PsnrForecast(seen).at(0.35)
        held += found.low_db <= truth <= found.high_db
    assert held / 400 == pytest.approx(COVERAGE, abs=0.08)


def test_the_interval_of_a_single_view_holds_what_it_says():
    """A view deviates from the line by 2 dB, and the line of chosen views is off by another 2 dB."""
    held = 0
    for seed in range(400):
        draw = np.random.default_rng(seed)
        seen = photographs(8, seed + 1_000)
        truth = 33.0 - 24.0 * 0.35 + draw.normal(0.0, 2.0) + draw.normal(0.0, 2.0)
        (found,) = PsnrForecast(seen).of_views(np.array([0.35]))
        held += found.low_db <= truth <= found.high_db
    assert held / 400 == pytest.approx(COVERAGE, abs=0.08)


def test_single_views_have_the_expectation_of_the_mean_and_wider_intervals():
    forecast = PsnrForecast(photographs(8, 3))
    variances = np.array([0.2, 0.9])
    for single, variance in zip(forecast.of_views(variances), variances.tolist(), strict=True):
        mean = forecast.at(variance)
        assert single.db == pytest.approx(mean.db)
        assert single.high_db - single.low_db > mean.high_db - mean.low_db


def test_the_interval_narrows_with_photographs_and_widens_away_from_them():
    def width(count: int, variance: float) -> float:
        found = PsnrForecast(photographs(count, 1)).at(variance)
        return found.high_db - found.low_db

    assert width(30, 0.4) < width(5, 0.4)
    assert width(10, 2.0) > width(10, 0.5)
