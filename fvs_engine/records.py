"""Base class of records that become JSON, and the message for one that is not valid."""

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, ValidationError
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from fvs_engine.field_docstrings import field_docstrings


class Record(BaseModel):
    """Base of settings, reports and state files: frozen; unknown fields and non-finite numbers are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler, /
    ) -> JsonSchemaValue:
        """The JSON schema, with the docstrings of the fields.

        pydantic's ``use_attribute_docstrings`` reads the sources whenever a process starts.
        """
        described = handler(schema)
        properties = handler.resolve_ref_schema(described).get("properties", {})
        for base in (base for base in cls.__mro__ if issubclass(base, Record)):
            for name, docstring in field_docstrings(base.__module__).get(base.__name__, {}).items():
                if name in properties:
                    properties[name].setdefault("description", docstring)
        return described


def first_error(error: ValidationError, whole: str = "the file") -> str:
    """The first validation error of a record, as ``where: what``; ``whole`` names the record itself."""
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"]) or whole
    return f"{where}: {first['msg'].removeprefix('Value error, ')}"
