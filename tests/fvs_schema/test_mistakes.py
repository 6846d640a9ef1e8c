"""Validation errors are plain sentences instead of pydantic's messages."""

from datetime import datetime
from typing import Annotated, Any, Literal

import pytest
from fvs_service.gateway.validation import invalid_body
from pydantic import Field, TypeAdapter, ValidationError

from fvs_schema.base import Model, Timestamp
from fvs_schema.mistakes import sentence
from fvs_schema.names import CandidateId, Digest, ImageName, SceneName, VehicleName
from fvs_schema.quantities import Number


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (Annotated[float, Field(ge=-2)], -3, "it must be at least -2"),
        (Annotated[float, Field(le=1e9)], 1e10, "it must be at most 1000000000"),
        (Annotated[float, Field(gt=0)], 0, "it must be more than 0"),
        (Annotated[float, Field(lt=1.5)], 2, "it must be less than 1.5"),
        (Number, "two", "it must be a number"),
        (float, "two", "it must be a number"),
        (Number, float("nan"), "it must be a finite number"),
        (int, "two", "it must be a whole number"),
        (int, 2.5, "it must be a whole number"),
        (int, 1e300, "it must be a whole number"),
        (str, 2, "it must be a string"),
        (bool, "perhaps", "it must be true or false"),
        (list[int], 2, "it must be a list"),
        (tuple[int, ...], 2, "it must be a list"),
        (Model, 2, "it must be an object"),
        (dict[str, int], 2, "it must be an object"),
        (datetime, "today", "it must be a time, as in RFC 3339"),
        (Timestamp, "2026-01-01T00:00:00", "it must have a time zone"),
        (Literal["a", "b"], "c", "it must be 'a' or 'b'"),
        (Annotated[tuple[int, ...], Field(min_length=1)], [], "it must not be empty"),
        (Annotated[list[int], Field(min_length=2)], [1], "it must have at least 2 items; it has 1"),
        (Annotated[list[int], Field(max_length=1)], [1, 2], "it must have at most 1 item; it has 2"),
        (tuple[int, int], [1, 2, 3], "it must have at most 2 items; it has 3"),
        (Annotated[str, Field(min_length=1)], "", "it must not be empty"),
        (Annotated[str, Field(max_length=1)], "ab", "it must have at most 1 character"),
        (Annotated[str, Field(pattern="^[0-9]+$")], "a", "it must match the pattern ^[0-9]+$"),
        (SceneName, "a\nb", "it must not have control characters"),
        (ImageName, "a/b", "it must not have slashes, backslashes or control characters"),
        (Digest, "a", "it must be sha256: and 64 lower-case hexadecimal digits"),
    ],
)
def test_pydantics_words_are_replaced(kind: Any, value: Any, said: str) -> None:
    with pytest.raises(ValidationError) as wrong:
        TypeAdapter(dict[str, kind]).validate_python({"field": value})
    refused = invalid_body(wrong.value, {"field": value})
    assert refused.errors[0].message == said
    assert refused.message == f"`field` {said.removeprefix('it ')}."


@pytest.mark.parametrize(("kind", "longest"), [(VehicleName, 64), (CandidateId, 128)])
def test_which_characters_a_name_may_have_is_said(kind: Any, longest: int) -> None:
    for name in ("two words", "-a", "a" * (longest + 1), ""):
        with pytest.raises(ValidationError) as wrong:
            TypeAdapter(kind).validate_python(name)
        (error,) = invalid_body(wrong.value, name).errors
        assert error.message.startswith(f"it must be 1 to {longest} letters, digits and . _ ~ : @ + -, ")
    for character in "._~:@+-":
        TypeAdapter(kind).validate_python(f"a{character}")


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("two views have the id a", "Two views have the id a."),
        ("lowest_height_m is not below highest_height_m", "lowest_height_m is not below highest_height_m."),
        (
            "latitude_deg, longitude_deg and altitude_m belong together",
            "latitude_deg, longitude_deg and altitude_m belong together.",
        ),
        (
            "around-current needs current_pose and radius_m",
            "around-current needs current_pose and radius_m.",
        ),
    ],
)
def test_names_keep_their_case_at_the_beginning_of_a_sentence(message: str, said: str) -> None:
    assert sentence("", message) == said


def test_a_list_with_a_wrong_item_is_not_called_empty() -> None:
    body = {"field": ["two"], "other": []}
    with pytest.raises(ValidationError) as wrong:
        TypeAdapter(
            dict[str, Annotated[tuple[int, ...], Field(min_length=1, fail_fast=True)]]
        ).validate_python(body)
    refused = invalid_body(wrong.value, body)
    assert [(error.field, error.message) for error in refused.errors] == [
        ("field.0", "it must be a whole number"),
        ("other", "it must not be empty"),
    ]


def test_a_sentence_ends_once() -> None:
    assert sentence("volume", "The up vector is zero.") == "volume: The up vector is zero."
    assert sentence("", "The up vector is zero.") == "The up vector is zero."
