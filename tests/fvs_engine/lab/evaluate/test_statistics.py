import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.evaluate.statistics import estimate, paired_difference


def test_three_values_by_hand() -> None:
    # mean 2, sample deviation 1, t of 2 degrees of freedom at 97.5 %: 4.302653
    found = estimate([1.0, 2.0, 3.0])
    assert found.mean == pytest.approx(2.0)
    assert found.half_width == pytest.approx(4.302653 / np.sqrt(3), rel=1e-6)
    assert found.count == 3


@given(st.lists(st.floats(-1e3, 1e3).map(lambda x: round(x, 3)), min_size=2, max_size=12))
def test_intervals_are_those_of_scipy(values: list[float]) -> None:
    found = estimate(values)
    spread = np.std(values, ddof=1)
    if spread == 0:
        assert found.half_width == 0
        return
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), spread / np.sqrt(len(values)))
    assert found.low == pytest.approx(low, rel=1e-9, abs=1e-9)
    assert found.high == pytest.approx(high, rel=1e-9, abs=1e-9)


def test_one_value_has_no_interval() -> None:
    found = estimate([3.5])
    assert (found.mean, found.half_width, found.low, found.high) == (3.5, None, None, None)


@pytest.mark.parametrize("values", [[], [1.0, float("nan")], [float("inf")]])
def test_no_mean_of_nothing_or_of_what_is_no_number(values: list[float]) -> None:
    with pytest.raises(InvalidInputError):
        estimate(values)


def test_the_luck_of_a_seed_cancels_in_paired_differences() -> None:
    baseline = {0: 10.0, 1: 20.0, 2: 30.0}
    better = {seed: value + 0.5 for seed, value in baseline.items()}
    gain = paired_difference(better, baseline)
    assert gain is not None
    assert gain.mean == pytest.approx(0.5)
    assert gain.half_width == pytest.approx(0.0, abs=1e-12)


def test_only_shared_seeds_are_compared() -> None:
    gain = paired_difference({0: 5.0, 7: 100.0}, {0: 4.0, 1: 0.0})
    assert gain is not None
    assert (gain.mean, gain.count) == (1.0, 1)
    assert paired_difference({0: 1.0}, {1: 1.0}) is None
