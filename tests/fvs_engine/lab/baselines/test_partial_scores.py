"""Scores that are known before the end are passed on as they are computed."""

import pytest

from fvs_engine.lab.baselines import SELECTORS, create_selector
from fvs_engine.monitor import Monitor

ONE_BY_ONE = (
    "median-frequency", "median-frequency-fast", "median-frequency-estimate", "spectral-median", "fisher",
    "d-optimal", "coverage",
)  # fmt: skip


@pytest.mark.parametrize("method", SELECTORS)
def test_scores_are_passed_on_once_in_their_order(context, ring, method):
    parts = []
    scores = create_selector(method).score(
        context(ring(0, 40), ring(80, 120, 160)), Monitor(on_results=parts.append)
    )
    if method in ONE_BY_ONE:
        assert [len(part) for part in parts] == [1, 1, 1]
        assert tuple(one for part in parts for one in part) == scores
    else:
        assert parts == []
