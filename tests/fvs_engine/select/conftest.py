"""The fixtures of the selectors' tests."""

from conftest_of import conftest_of

_selectors = conftest_of("fvs_engine/score/selectors")
room = _selectors.room
