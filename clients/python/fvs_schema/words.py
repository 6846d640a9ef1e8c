"""The base of words on the wire, and names that command lines have, too. Imports nothing heavy."""

from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, Self

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, ValidationInfo, ValidatorFunctionWrapHandler
    from pydantic_core import CoreSchema

NEWER = "newer"
"""In the context of a validation: the sender may be newer, and its unknown words are kept."""

Method = Literal[
    "median-frequency",
    "median-frequency-fast",
    "median-frequency-estimate",
    "random",
    "uniform",
    "farthest",
    "nearest",
    "kriging",
    "fisher",
    "d-optimal",
    "coverage",
    "spectral-median",
]
"""The methods of ranking; `docs/reference/methods.md` describes them."""
POINTS = "points"
"""In place of a height model: the ground by the sparse points of the model."""


class Word(StrEnum):
    """Base of the words on the wire; of a newer sender (``NEWER``) unknown ones are kept."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: "GetCoreSchemaHandler") -> "CoreSchema":
        from pydantic_core import core_schema

        return core_schema.with_info_wrap_validator_function(cls._read, handler(source))

    @classmethod
    def _read(cls, value: Any, read: "ValidatorFunctionWrapHandler", info: "ValidationInfo") -> Self:
        if info.context and NEWER in info.context and isinstance(value, str):
            return cls.of(value)
        known: Self = read(value)
        return known

    @classmethod
    def of(cls, value: str) -> Self:
        """The word with this value, also when it is unknown."""
        try:
            return cls(value)
        except ValueError:
            word = str.__new__(cls, value)
            word._name_ = word._value_ = value
            return word
