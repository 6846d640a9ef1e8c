import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.score import CandidateScore, rank
from fvs_schema.candidates import CandidateStatus


def ranked(name: str, score: float) -> CandidateScore:
    return CandidateScore(name, score, CandidateStatus.RANKED, 0.9)


def ids(places):
    return [place.name for place in places]


@given(values=st.lists(st.floats(-10, 10), max_size=20))
def test_the_lowest_score_comes_first(values):
    places = rank(ranked(str(i), value) for i, value in enumerate(values))
    assert [place.score for place in places] == sorted(values)
    assert [place.rank for place in places] == list(range(1, len(values) + 1))


def test_ties_are_broken_by_distance_then_by_id():
    scores = [ranked(name, 1.0) for name in ("d", "c", "b", "a")]
    assert ids(rank(scores, {"a": 3.0, "b": 1.0, "c": 3.0})) == ["b", "a", "c", "d"]
    assert ids(rank(scores)) == ["a", "b", "c", "d"]
    assert rank(scores, {"b": 1.0})[0].distance == 1.0


def test_what_cannot_be_compared_follows_without_a_rank():
    scores = [
        CandidateScore("void", None, CandidateStatus.OUT_OF_MODEL, 0.0),
        CandidateScore("thin", -9.0, CandidateStatus.LOW_COVERAGE, 0.02),
        ranked("second", 2.0),
        ranked("first", 1.0),
    ]
    places = rank(scores, {"void": 1.0})
    assert ids(places) == ["first", "second", "thin", "void"]
    assert [place.rank for place in places] == [1, 2, None, None]


@given(order=st.permutations(list("abcdef")))
def test_the_order_of_the_input_does_not_matter(order):
    scores = {name: ranked(name, float(ord(name) % 2)) for name in "abcdef"}
    assert ids(rank(scores[name] for name in order)) == ["b", "d", "f", "a", "c", "e"]


def test_an_id_twice_is_refused():
    with pytest.raises(InvalidInputError, match="more than once"):
        rank([ranked("a", 1.0), ranked("a", 2.0)])


@pytest.mark.parametrize("distance", [math.nan, math.inf, -1.0])
def test_impossible_distances_are_refused(distance):
    with pytest.raises(InvalidInputError):
        rank([ranked("a", 1.0)], {"a": distance})
