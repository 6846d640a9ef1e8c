"""Inputs are strict, outputs lenient; words of a newer sender are kept where they may be."""

import subprocess
import sys
from typing import Literal

import pytest
from pydantic import ValidationError

from fvs_schema.base import Input, Output
from fvs_schema.error_codes import FieldError
from fvs_schema.jobs import JobKind, JobRequest
from fvs_schema.mistakes import InvalidInput
from fvs_schema.words import NEWER, Word


class Colour(Word):
    RED = "red"


class Asked(Input):
    kind: Literal["asked"] = "asked"
    colour: Colour = Colour.RED
    parts: tuple["Asked", ...] = ()


class Answered(Output):
    colour: Colour
    asked: Asked


def test_inputs_refuse_unknown_fields_and_outputs_ignore_them() -> None:
    with pytest.raises(InvalidInput) as caught:
        Asked(parts=[{"size": 1}])
    assert caught.value.errors == (FieldError("parts.0.size", "there is no such field"),)
    answer = Answered.model_validate({"colour": "red", "asked": {}, "size": 1})
    assert answer == Answered(colour=Colour.RED, asked=Asked())


def test_a_newer_sender_may_have_more_words_and_fields() -> None:
    sent = {"colour": "blue", "asked": {"colour": "green", "size": 1}}
    found = Answered.model_validate(sent, extra="ignore", context={NEWER: True})
    assert (found.colour, found.asked.colour) == ("blue", "green")
    assert found.model_dump(mode="json")["colour"] == "blue"
    assert isinstance(found.colour, Colour)
    for context in (None, {}):
        with pytest.raises(ValidationError, match="red"):
            Answered.model_validate(sent, extra="ignore", context=context)
    with pytest.raises(ValidationError):
        Answered.model_validate({"colour": 3, "asked": {}}, context={NEWER: True})


def test_what_tells_the_members_of_a_union_is_required_in_the_schema() -> None:
    schema = Asked.model_json_schema()
    described = schema["$defs"]["Asked"] if "$defs" in schema else schema
    assert described["required"] == ["kind"]
    assert "default" not in described["properties"]["kind"]


@pytest.mark.process
def test_command_lines_have_the_words_without_pydantic() -> None:
    code = "import sys, fvs_schema.stages, fvs_schema.error_codes; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_docstrings_describe_fields() -> None:
    assert JobRequest.model_json_schema()["properties"]["kind"]["description"] == "What to do."
    assert JobKind.of("update") is JobKind.UPDATE
