"""Bases of the records on the wire, and of their lists."""

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from fvs_schema.field_docstrings import field_docstrings
from fvs_schema.mistakes import InvalidInput

Timestamp = AwareDatetime


class Model(BaseModel):
    """Base of all records: frozen, with finite numbers; the docstring of a field is its description."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler, /
    ) -> JsonSchemaValue:
        """The JSON schema, with the docstrings of the fields; the kind of a member of a union is required.

        pydantic's ``use_attribute_docstrings`` reads the sources whenever a process starts.
        """
        described = handler(schema)
        resolved = handler.resolve_ref_schema(described)
        properties = resolved.get("properties", {})
        for base in (base for base in cls.__mro__ if issubclass(base, Model)):
            for name, docstring in field_docstrings(base.__module__).get(base.__name__, {}).items():
                if name in properties:
                    properties[name].setdefault("description", docstring)
        for name, field in properties.items():
            if "const" in field and "default" in field:
                del field["default"]
                resolved["required"] = [name, *resolved.get("required", ())]
        return described


class Output(Model):
    """Base of what the service answers: unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore")


class Input(Model):
    """Base of what is sent to the service: unknown fields are errors.

    The constructor raises ``InvalidInput``, a ``ValueError``, for what does not fit.
    """

    model_config = ConfigDict(extra="forbid")

    if not TYPE_CHECKING:  # a type checker knows the fields

        def __init__(self, **fields: Any) -> None:
            try:
                # What pydantic's constructor does: to call it would take a third longer.
                self.__pydantic_validator__.validate_python(fields, self_instance=self)
            except ValidationError as error:
                raise InvalidInput(error, fields, type(self)) from None

        # pydantic does not call this constructor for the parts of an object.
        __init__.__pydantic_base_init__ = True


class Page(Input):
    """A page of a list: ``limit`` items after the one with the cursor ``after``."""

    after: str | None = Field(default=None, max_length=128, description="The `next` of the previous page.")
    limit: int = Field(default=100, ge=1, le=1000, description="Items of the page.")


ItemT = TypeVar("ItemT", bound=Model)


class Listing(Output, Generic[ItemT]):
    """A page of a list."""

    items: tuple[ItemT, ...]
    """The items of this page."""
    next: str | None
    """The cursor of the next page; null on the last one."""
