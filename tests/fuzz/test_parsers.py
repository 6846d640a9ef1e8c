"""A short run of the fuzzers; ``parsers.py`` runs them for minutes."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from fuzzing import Report, fuzz_all
from parsers import TARGETS


@pytest.fixture(scope="module")
def reports() -> dict[str, Report]:
    """The report of each target."""
    return {report.target: report for report in fuzz_all(TARGETS, cases=150)}


@pytest.mark.system
@pytest.mark.timeout(240)
@pytest.mark.parametrize("target", [target.name for target in TARGETS])
def test_a_few_damaged_files_are_read_or_refused(reports: dict[str, Report], target: str) -> None:
    report = reports[target]
    assert report.clean, report.findings
    assert report.cases == 150
    assert report.accepted
    assert report.refused
