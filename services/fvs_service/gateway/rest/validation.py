"""Errors for requests that do not fit their model: which part is invalid, and why."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError

from fvs_service.errors import (
    FieldError,
    InvalidRequestError,
    MalformedRequestError,
    ServiceError,
    UnsupportedMediaTypeError,
)

_MAX_FIELDS = 32
_VALIDATOR = "Value error, "
"""Pydantic's prefix of the messages of our validators."""
_MESSAGES = {"extra_forbidden": "there is no such field", "missing": "it is missing"}
_HINT = "GET /openapi.json describes the request."


def error_of(request: Request, error: RequestValidationError) -> ServiceError:
    """The service's error for one of the framework's."""
    found = error.errors()
    for item in found:
        if item["type"] == "json_invalid":
            reason = item.get("ctx", {}).get("error", "it is broken")
            return MalformedRequestError(
                f"The body is not JSON: {reason}, at character {item['loc'][-1]}.",
                hint="See RFC 8259 for the syntax of JSON.",
            )
    if any(tuple(item["loc"]) == ("body",) for item in found) and not _is_json(request, error.body):
        kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        return UnsupportedMediaTypeError(
            f"The body is {kind}." if kind else "The body has no Content-Type.",
            hint="Send JSON with Content-Type: application/json.",
        )
    fields = tuple(_field(item, error.body) for item in found[:_MAX_FIELDS])
    first = fields[0]
    sentence = f"{first.field}: {first.message}." if first.field else _sentence(first.message)
    return InvalidRequestError(sentence, errors=fields, hint=_HINT)


def _sentence(message: str) -> str:
    return f"{message[:1].upper()}{message[1:]}."


def _is_json(request: Request, body: object) -> bool:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    return kind.endswith(("/json", "+json")) or body is None


def _field(item: Mapping[str, Any], body: object) -> FieldError:
    message = _MESSAGES.get(item["type"]) or str(item["msg"]).removeprefix(_VALIDATOR)
    where, *inside = item["loc"]
    if where == "body":
        inside = _path(inside, body, missing=item["type"] == "missing")
    return FieldError(".".join(map(str, inside)), message)


def _path(location: Sequence[str | int], body: object, *, missing: bool) -> list[str | int]:
    """The path to a part of ``body``: pydantic's without the names of union members."""
    path: list[str | int] = []
    for part, following in pairwise((*location, None)):
        if isinstance(body, list) and isinstance(part, int):
            path.append(part)
            body = body[part] if part < len(body) else None
        elif isinstance(body, Mapping) and isinstance(part, str):
            inner = body.get(part)
            if following is None:
                wanted = missing or part in body
            else:
                inside_a_scalar = part in body and not missing and following not in body
                wanted = isinstance(inner, Mapping | list) or inside_a_scalar
            if wanted:
                path.append(part)
                body = inner
    return path
