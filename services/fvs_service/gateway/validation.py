"""Errors for requests that do not fit their model: which part is invalid, and why."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from fvs_service.errors import FieldError, InvalidRequestError
from fvs_service.gateway.plain_messages import plain_message, sentence
from fvs_service.model import OF_FIELDS

_MAX_FIELDS = 16
_MAX_CHARACTERS = 300
"""Maximum length of a field's name and of a message: both may repeat what was sent."""
_HINT = "GET /openapi.json describes the request."


def invalid_request(error: RequestValidationError) -> InvalidRequestError:
    """The error for path, query and headers that do not fit."""
    found = error.errors()[:_MAX_FIELDS]
    return _error(found, (item["loc"][1:] for item in found))


def invalid_body(error: ValidationError, body: object, hint: str = _HINT) -> InvalidRequestError:
    """The error for a ``body`` that does not fit its model; ``hint`` names the description of the model."""
    found = _of_the_sender(error.errors(include_url=False, include_input=False))[:_MAX_FIELDS]
    paths = (_path(item["loc"], body, missing=item["type"] == "missing") for item in found)
    return _error(found, paths, hint)


def _of_the_sender(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """All but those of lists that are too short only because their wrong items do not count."""
    return [
        each
        for each in errors
        if each["type"] != "too_short"
        or not any(other["loc"][: len(each["loc"])] == each["loc"] for other in errors if other is not each)
    ]


def _error(
    errors: Sequence[Mapping[str, Any]], paths: Iterable[Iterable[str | int]], hint: str = _HINT
) -> InvalidRequestError:
    found: dict[FieldError, None] = {}  # dependencies may share a parameter
    for error, path in zip(errors, paths, strict=True):
        found.update(dict.fromkeys(_fields(error, tuple(path))))
    first = next(iter(found))
    about = "" if errors[0]["type"] == OF_FIELDS else first.field
    return InvalidRequestError(sentence(about, first.message), errors=tuple(found), hint=hint)


def _fields(error: Mapping[str, Any], path: tuple[str | int, ...]) -> Iterator[FieldError]:
    """The invalid field at ``path``, or those of the object there that the error is about."""
    context = error.get("ctx", {})
    message = _short(plain_message(error["type"], error["msg"], context))
    inner = [(name,) for name in context["fields"]] if error["type"] == OF_FIELDS else [()]
    for names in inner:
        yield FieldError(_short(".".join(map(str, (*path, *names)))), message)


def _short(text: str) -> str:
    return text if len(text) <= _MAX_CHARACTERS else f"{text[:_MAX_CHARACTERS]}…"


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
