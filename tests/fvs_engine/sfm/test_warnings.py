"""Tests of which warnings of structure from motion are still true."""

from fvs_engine.sfm.warnings import doubtful, not_registered, without_doubts, without_registered

RELATED, OTHER = "1.jpg", "11.jpg"


def test_a_warning_about_an_image_ends_when_it_is_registered():
    about, others = not_registered(RELATED, "too few"), (not_registered(OTHER, "too few"), "Something else.")
    assert without_registered([about, *others], [RELATED]) == others


def test_doubts_end_when_the_model_is_replaced_also_behind_their_occasion():
    doubts = [doubtful("x."), f"Match support fell. {doubtful('y.')}"]
    assert without_doubts([doubts[0], "Something else.", doubts[1]]) == ("Something else.",)
