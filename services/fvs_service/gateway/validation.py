"""Errors for requests that do not fit their model: which part is invalid, and why."""

from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError

from fvs_schema.mistakes import field_errors, found_in, summary
from fvs_service.errors import InvalidRequestError

_HINT = "GET /openapi.json describes the request."


def invalid_request(error: RequestValidationError) -> InvalidRequestError:
    """The error for path, query and headers that do not fit."""
    found = error.errors()
    fields = field_errors(found, (item["loc"][1:] for item in found))
    return InvalidRequestError(summary(found, fields), errors=fields, hint=_HINT)


def invalid_body(error: ValidationError, body: object, hint: str = _HINT) -> InvalidRequestError:
    """The error for a ``body`` that does not fit its model; ``hint`` names the description of the model."""
    found = error.errors(include_url=False, include_input=False)
    fields = found_in(found, body)
    return InvalidRequestError(summary(found, fields), errors=fields, hint=hint)
