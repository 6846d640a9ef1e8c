"""Bases of the models, and the types they share."""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, Self, dataclass_transform

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from fvs_client.models.mistakes import mistakes

ReprArgs = Iterable[tuple[str, object]]
"""What ``repr`` shows of a model."""
Timestamp = AwareDatetime
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Unit, w first."""


_OF_OBJECTS = frozenset(dir(object))
_OF_MODELS = frozenset(dir(BaseModel))


if TYPE_CHECKING:

    @dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(Field, PrivateAttr))
    class Model:
        """What editors are told of pydantic's model: its fields, and the few methods that are of use."""

        model_fields: ClassVar[Mapping[str, Any]]

        def model_dump(
            self, *, mode: str = ..., by_alias: bool = ..., exclude_none: bool = ...
        ) -> dict[str, Any]:
            """The fields by name; with the mode `json` as JSON has them."""

        def model_dump_json(self, *, by_alias: bool = ..., indent: int | None = ...) -> str:
            """The model as JSON."""

        def model_copy(self, *, update: Mapping[str, Any] = ...) -> Self:
            """A copy with other values, which are not checked."""

        @classmethod
        def model_validate(cls, obj: object, *, context: object = ...) -> Self:
            """The model with the fields of a dictionary."""

        @classmethod
        def model_validate_json(cls, json_data: str | bytes, *, context: object = ...) -> Self:
            """The model with the fields of a JSON object."""

else:

    class Model(BaseModel):
        """Base of all models: immutable."""

        model_config = ConfigDict(frozen=True)

        def __str__(self) -> str:
            return repr(self)

        def __dir__(self) -> Iterable[str]:
            """What a model offers, without what pydantic adds."""
            hidden = [name for name in super().__dir__() if name in _OF_MODELS or name.startswith("__")]
            return sorted({*super().__dir__()} - {*hidden} | _OF_OBJECTS)

        def __setattr__(self, name: str, value: object) -> None:
            if not name.startswith("_"):
                _refuse(self, name)
            super().__setattr__(name, value)

        def __delattr__(self, name: str) -> NoReturn:
            _refuse(self, name)


def _refuse(model: Model, name: str) -> NoReturn:
    raise AttributeError(f"{type(model).__name__} is immutable: its `{name}` cannot be set.") from None


class Answer(Model):
    """Base of what the service answers; unknown fields of a newer service are ignored."""

    model_config = ConfigDict(extra="ignore")


class Input(Model):
    """Base of what is sent to the service: strict, so that misspelt fields are errors.

    Raises ``ValueError`` for what does not fit.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    if not TYPE_CHECKING:  # a type checker knows the fields

        def __init__(self, **fields: Any) -> None:
            try:
                super().__init__(**fields)
            except ValidationError as error:
                raise ValueError(mistakes(error, fields, type(self))) from None

        # Only whoever makes an object gets here, not pydantic for the parts of one.
        __init__.__pydantic_base_init__ = True

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
