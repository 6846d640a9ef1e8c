"""Bases of the models, and the types they share."""

from enum import StrEnum
from typing import Any, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, ValidationInfo, model_validator

Timestamp = AwareDatetime
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Unit, w first."""


class Answer(BaseModel):
    """Base of what the service answers: immutable; unknown fields of a newer service are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Input(BaseModel):
    """Base of what is sent to the service: immutable and strict, so that misspelt fields are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _of_a_newer_service(cls, value: Any, info: ValidationInfo) -> Any:
        """Ignore unknown fields where a newer service echoes an input."""
        if info.context is None or not isinstance(value, dict) or value.keys() <= cls.model_fields.keys():
            return value
        return {name: part for name, part in value.items() if name in cls.model_fields}

    def document(self) -> dict[str, Any]:
        """The JSON object, without fields that are None."""
        return self.model_dump(mode="json", exclude_none=True)


class Word(StrEnum):
    """Base of the API's enumerations: an unknown value of a newer service is kept."""

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, str):
            return None
        word = str.__new__(cls, value)
        word._name_ = word._value_ = value
        return word
