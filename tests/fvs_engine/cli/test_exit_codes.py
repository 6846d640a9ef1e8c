from pathlib import Path

import pytest

from fvs_engine import errors
from fvs_engine.cli.exit_codes import BUG, EXIT_CODES, OK, USAGE, exit_code_of
from fvs_engine.errors import EngineError
from fvs_engine.files.storage import DiskFullError
from fvs_engine.images.pixels import UnusableImageError

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "exit-statuses.md"


def _all_errors() -> list[type[EngineError]]:
    found = [value for value in vars(errors).values() if isinstance(value, type)]
    return [value for value in found if issubclass(value, EngineError)] + [DiskFullError]


def test_every_error_has_a_status_of_its_own() -> None:
    # Without __init__: some errors need more than a message.
    statuses = {error.code: exit_code_of(error.__new__(error)) for error in _all_errors()}
    assert statuses == {error.code: EXIT_CODES[error.code] for error in _all_errors()}
    assert len(set(statuses.values()) | {OK, BUG, USAGE}) == len(statuses) + 3


def test_an_error_without_a_status_takes_that_of_its_ancestor() -> None:
    assert exit_code_of(UnusableImageError("x")) == EXIT_CODES["invalid-input"]

    class NewError(errors.TrainingError):
        code = "not-in-the-table"

    assert exit_code_of(NewError("x")) == EXIT_CODES["training-failed"]


@pytest.mark.parametrize("code", EXIT_CODES)
def test_the_documentation_lists_the_status(code: str) -> None:
    assert f"| {EXIT_CODES[code]} | `{code}` |" in PAGE.read_text(encoding="utf-8")
