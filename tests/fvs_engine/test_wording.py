"""Tests of the sentences and hints of findings."""

import string

import pytest

from fvs_engine.wording import WORDING, hint, notice, sentence, text
from fvs_schema.findings import Finding, FindingCode, Severity

GIVEN = {"images", "count", "pairs", "against"}


class _Samples(dict[str, float | str]):
    """A value for every field of a format string, as its format wants it."""

    @classmethod
    def of(cls, template: str) -> "_Samples":
        parsed = [(name, spec) for _, name, spec, _ in string.Formatter().parse(template) if name]
        return cls({name: 2.0 if spec else "x" for name, spec in parsed if name not in GIVEN})


@pytest.mark.parametrize("code", FindingCode)
def test_every_code_has_a_sentence_and_a_hint(code: FindingCode) -> None:
    data = _Samples.of("".join(WORDING[code]))
    finding = Finding.of(code, ["a.jpg", "b.jpg"], **data)
    assert sentence(finding)[0].isupper() or sentence(finding)[0].isdigit() or "{" in WORDING[code][0][:1]
    assert sentence(finding).endswith((".", "x"))
    assert hint(finding).endswith((".", "x"))
    assert text(finding) == f"{sentence(finding)} {hint(finding)}"


def test_a_doubt_says_so_and_many_images_are_counted() -> None:
    names = [f"{number}.jpg" for number in range(10)]
    doubt = Finding.of(FindingCode.LOOSELY_LINKED, names, Severity.DOUBT)
    assert sentence(doubt).startswith("DOUBTFUL CAMERAS: Only a few matches connect 0.jpg, 1.jpg, ")
    assert "7.jpg and 2 more with the rest" in sentence(doubt)


def test_conflicting_views_are_named_in_pairs() -> None:
    finding = Finding.of(FindingCode.CONFLICTING_VIEWS, ["a", "b", "a", "c"])
    assert sentence(finding).startswith("a and b, a and c should overlap")


def test_what_is_against_candidates_is_counted() -> None:
    finding = Finding(code=FindingCode.NONE_FEASIBLE, numbers={"of": 8, "too-close": 5, "in-matter": 3})
    said = "None of the 8 candidates is feasible: 3 inside matter, 5 too close to matter."
    assert sentence(finding) == said


def test_a_notice_is_the_finding_with_its_sentence() -> None:
    finding = Finding.of(FindingCode.UNMATCHED, ["a.jpg"], first_images=10)
    shown = notice(finding)
    assert shown.message == "The first 10 images: Not registered, as no other image matches: a.jpg."
    assert (shown.code, shown.images, shown.hint) == (finding.code, finding.images, hint(finding))


def test_a_finding_survives_json() -> None:
    finding = Finding.of(FindingCode.FAR_FROM_PRIORS, ["a.jpg"], Severity.REJECTION, of=12, source="GPS")
    assert Finding.model_validate_json(finding.model_dump_json()) == finding
