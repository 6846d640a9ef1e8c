"""A short run of the fuzzers; ``parsers.py`` runs them for minutes."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from fuzzing import fuzz
from parsers import TARGETS


@pytest.mark.timeout(240)
@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_a_few_damaged_files_are_read_or_refused(target: object) -> None:
    report = fuzz(target, cases=150)
    assert report.clean, report.findings
    assert report.cases == 150
    assert report.accepted
    assert report.refused
