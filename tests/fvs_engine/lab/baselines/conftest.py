"""The fixtures of the selectors' tests."""

from conftest_of import conftest_of

_selectors = conftest_of("fvs_engine/score/selectors")
ball = _selectors.ball
chosen_in_turn = _selectors.chosen_in_turn
context = _selectors.context
cpu = _selectors.cpu
reference = _selectors.reference
ring = _selectors.ring
view_at = _selectors.view_at
