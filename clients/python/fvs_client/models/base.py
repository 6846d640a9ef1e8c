"""What all models have in common."""

from enum import StrEnum
from typing import Any, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, ValidationInfo, model_validator

Timestamp = AwareDatetime
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Unit, w first."""


class Answer(BaseModel):
    """Base of what the service answers: immutable; fields that a newer service adds are left out."""

    model_config = ConfigDict(frozen=True, extra="ignore", use_attribute_docstrings=True)


class Input(BaseModel):
    """Base of what the service is sent: immutable, and strict, so that a misspelt field fails here."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _of_a_newer_service(cls, value: Any, info: ValidationInfo) -> Any:
        """An echoed input may have fields that only a newer service knows."""
        if info.context is None or not isinstance(value, dict):
            return value
        return {name: part for name, part in value.items() if name in cls.model_fields}

    def document(self) -> dict[str, Any]:
        """As JSON has it, without what was not given."""
        return self.model_dump(mode="json", exclude_none=True)


class Word(StrEnum):
    """Base of the words of the API: a word that a newer service says is kept, not refused."""

    @classmethod
    def _missing_(cls, value: object) -> Self | None:
        if not isinstance(value, str):
            return None
        word = str.__new__(cls, value)
        word._name_ = word._value_ = value
        return word
