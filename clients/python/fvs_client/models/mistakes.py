"""What does not fit a model, in plain words."""

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import pydantic

_MOST = 3
"""Mistakes that are named; one is often the reason of the others."""
_LONGEST = 60
"""Longest text of a wrong value."""
_MESSAGES = {
    "missing": "is missing",
    "union_tag_not_found": "has no kind",
    "union_tag_invalid": "has a kind that is none of {expected_tags}",
    "literal_error": "must be {expected}",
    "enum": "must be {expected}",
    "finite_number": "must be a finite number",
    "timezone_aware": "must have a time zone",
    "too_short": "must have at least {min_length} items",
    "too_long": "must have at most {max_length} items",
    "value_error": "must be {error}",
    "json_invalid": "is no JSON: {error}",
}
"""By pydantic's type of an error, whose context fills the braces."""
_VALUES = {
    "float": "a number",
    "int": "a whole number",
    "string": "a string",
    "bool": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dict": "an object",
    "datetime": "a time, as in RFC 3339",
}
"""By the first word of types such as ``float_parsing`` and ``float_type``."""


def mistakes(
    error: pydantic.ValidationError, given: object, model: type[pydantic.BaseModel] | None = None
) -> str:
    """What is wrong with ``given``, in sentences; ``model`` is what it was to be."""
    sentences = dict.fromkeys(_sentence(one, given, model) for one in error.errors(include_url=False))
    more = len(sentences) - _MOST
    return " ".join([*sentences][:_MOST]) + (f" And {more} more." if more > 0 else "")


def _sentence(error: Any, given: object, model: type[pydantic.BaseModel] | None) -> str:
    path = _path(error["loc"], given)
    kind = error["type"]
    if kind == "missing" and path and isinstance(path[-1], int):
        path, what = path[:-1], "has too few items"
    elif kind == "extra_forbidden":
        what = "is no field"
        if model is not None and len(path) == 1:
            similar = get_close_matches(str(path[0]), model.model_fields, 1)
            what += f" of {model.__name__}" + "".join(f"; did you mean `{name}`?" for name in similar)
    else:
        what = _message(kind, error)
    name = ".".join(map(str, path))
    subject = f"`{name}`" if name else "It"
    return f"{subject} {what.removesuffix('.')}" + ("" if what.endswith("?") else ".")


def _message(kind: str, error: Any) -> str:
    context = error.get("ctx", {})
    if kind in _MESSAGES:
        return _MESSAGES[kind].format_map(context)
    given = repr(error["input"])
    shown = given if len(given) <= _LONGEST else type(error["input"]).__name__
    value = _VALUES.get(kind.partition("_")[0])
    if kind == "model_type" and error["loc"]:
        value = f"of the class {context['class_name']}"
    elif kind in ("model_type", "model_attributes_type"):
        value = "an object"
    if value is not None:
        return f"must be {value}, not {shown}"
    return str(error["msg"]).replace("Input should", "must")


def _path(location: Sequence[str | int], given: object) -> list[str | int]:
    """Pydantic's path to a part of ``given``, without the names of union members."""
    path: list[str | int] = []
    for index, part in enumerate(location):
        if isinstance(given, Mapping):
            if part in given or index == len(location) - 1:
                path.append(part)
                given = given.get(part)
        elif isinstance(given, list | tuple) and isinstance(part, int):
            path.append(part)
            given = given[part] if part < len(given) else None
    return path
