"""Tests of which warnings of structure from motion are still true."""

from fvs_engine.sfm.warnings import without_doubts, without_registered
from fvs_schema.findings import Finding, FindingCode, Severity

RELATED, OTHER = "1.jpg", "11.jpg"


def test_a_warning_about_an_image_ends_when_it_is_registered():
    about, other = (Finding.of(FindingCode.POSE_UNDETERMINED, [name]) for name in (RELATED, OTHER))
    texture = Finding.of(FindingCode.FEW_FEATURES, [RELATED])
    assert without_registered([about, other, texture], [RELATED]) == (other, texture)


def test_a_warning_about_several_images_goes_on_about_those_without_a_pose():
    both = Finding.of(FindingCode.UNREGISTERED, [RELATED, OTHER], of=12)
    assert without_registered([both], [RELATED]) == (Finding.of(FindingCode.UNREGISTERED, [OTHER], of=12),)


def test_the_same_warning_is_given_once():
    other = Finding.of(FindingCode.UNMATCHED, [OTHER])
    assert without_registered([other, Finding.of(FindingCode.UNMATCHED, [RELATED, OTHER])], [RELATED]) == (
        other,
    )


def test_doubts_end_when_the_model_is_replaced():
    doubt = Finding.of(FindingCode.LOOSELY_LINKED, [RELATED], Severity.DOUBT)
    other = Finding.of(FindingCode.UNCALIBRATED)
    assert without_doubts([doubt, other, doubt]) == (other,)
