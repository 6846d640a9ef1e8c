"""Base class of records that become JSON, and the message for one that is not valid."""

from pydantic import ConfigDict, ValidationError

from fvs_schema.base import Model
from fvs_schema.mistakes import plain_message


class Record(Model):
    """Base of settings, reports and state files: frozen; unknown fields and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid")


def first_error(error: ValidationError, whole: str = "the file") -> str:
    """The first validation error of a record, as ``where: what``; ``whole`` names the record itself."""
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"]) or whole
    return f"{where}: {plain_message(first['type'], first['msg'], first.get('ctx', {}))}"
