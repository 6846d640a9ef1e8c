"""The table of methods in the documents agrees with the selectors."""

import math
import re
from pathlib import Path

import pytest

from fvs_engine.lab.baselines import SELECTORS, create_selector

_PAGE = Path(__file__).parents[4] / "docs" / "reference" / "methods.md"
_BOUNDS = {
    "0 to 0.71": (0.0, math.sqrt(0.5)),
    "0 to 1": (0.0, 1.01),
    "0 or less": (-100.0, 0.0),
    "0 or more": (0.0, 100.0),
    "any number": (-100.0, 100.0),
}
"""What a range begins with, and its bounds; no score of the small scene is beyond 100."""


def _rows() -> dict[str, tuple[str, str]]:
    """The cells of score and range by method."""
    rows = re.findall(r"^\| `([a-z-]+)` \|(.*)\|$", _PAGE.read_text("utf-8"), re.MULTILINE)
    cells = {name: [cell.strip() for cell in row.split("|")] for name, row in rows}
    assert all(all(row[:4]) for row in cells.values())
    return {name: (row[1], row[2]) for name, row in cells.items()}


def test_the_table_lists_the_selectors_in_their_order():
    assert set(_rows()) == set(SELECTORS)


@pytest.mark.parametrize("method", SELECTORS)
def test_docstrings_say_what_a_score_is_as_the_table_does(method):
    docstring = " ".join((SELECTORS[method].__doc__ or "").split())
    score, bounds = _rows()[method]
    assert f"Score: {score}; {bounds}." in docstring


@pytest.mark.parametrize("method", SELECTORS)
def test_scores_are_in_the_range_of_the_table(context, ring, method):
    scores = create_selector(method).score(context(ring(0, 40), ring(5, 80, 120, 160, 270)))
    words = _rows()[method][1]
    least, most = next(bounds for begin, bounds in _BOUNDS.items() if words.startswith(begin))
    assert all(least <= one.score <= most for one in scores)
