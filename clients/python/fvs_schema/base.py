"""Bases of the records on the wire."""

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from fvs_schema.field_docstrings import field_docstrings


class Model(BaseModel):
    """Base of all records: frozen, with finite numbers; the docstring of a field is its description."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler, /
    ) -> JsonSchemaValue:
        """The JSON schema, with the docstrings of the fields.

        pydantic's ``use_attribute_docstrings`` reads the sources whenever a process starts.
        """
        described = handler(schema)
        properties = handler.resolve_ref_schema(described).get("properties", {})
        for base in (base for base in cls.__mro__ if issubclass(base, Model)):
            for name, docstring in field_docstrings(base.__module__).get(base.__name__, {}).items():
                if name in properties:
                    properties[name].setdefault("description", docstring)
        return described


class Output(Model):
    """Base of what the service answers: unknown fields are ignored."""

    model_config = ConfigDict(extra="ignore")


class Input(Model):
    """Base of what is sent to the service: unknown fields are errors."""

    model_config = ConfigDict(extra="forbid")
