"""What is wrong with an input, in plain sentences: which part, and why."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from itertools import islice, pairwise
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from fvs_schema.error_codes import FieldError
from fvs_schema.names import FORMS

OF_FIELDS = "of_fields"
"""The type of errors that are about several fields, which ``fields`` of their context names."""

_MAX_FIELDS = 16
_MAX_CHARACTERS = 300
"""Maximum length of a field's name and of a message: both may repeat what was sent."""
_MOST_SENTENCES = 3
"""Mistakes that are named; one is often the reason of the others."""
_MESSAGES = {
    "extra_forbidden": "there is no such field",
    "missing": "it is missing",
    "path_not_file": "there is no such file",
    "union_tag_not_found": "its kind is missing",
    "union_tag_invalid": "its kind must be one of {expected_tags}",
    "greater_than_equal": "it must be at least {ge}",
    "greater_than": "it must be more than {gt}",
    "less_than_equal": "it must be at most {le}",
    "less_than": "it must be less than {lt}",
    "finite_number": "it must be a finite number",
    "timezone_aware": "it must have a time zone",
    "literal_error": "it must be {expected}",
    "enum": "it must be {expected}",
    "value_error": "{error}",
    "too_short": "it must have at least {min_length} items; it has {actual_length}",
    "too_long": "it must have at most {max_length} items; it has {actual_length}",
    "string_too_short": "it must have at least {min_length} characters",
    "string_too_long": "it must have at most {max_length} characters",
    "string_pattern_mismatch": "it must match the pattern {pattern}",
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
    "model": "an object",
    "datetime": "a time, as in RFC 3339",
}
"""By the first word of types such as ``float_parsing`` and ``float_type``."""
_NOT_OF_ITS_TYPE = frozenset(
    {"type", "attributes_type", "parsing", "parsing_size", "from_date_parsing", "from_float", "unicode"}
)


class InvalidInput(ValueError):  # noqa: N818 - a value that does not fit, not a failure
    """The fields given for an input do not fit; ``errors`` has them."""

    def __init__(self, error: ValidationError, given: object, kind: type[BaseModel]) -> None:
        errors = error.errors(include_url=False, include_input=False)
        self.errors = found_in(errors, given)
        super().__init__(_sentences(errors, given, kind.model_fields))


def found_in(errors: Sequence[ErrorDetails], given: object) -> tuple[FieldError, ...]:
    """The invalid parts of ``given``, at least one."""
    found = _of_the_sender(errors)
    return field_errors(
        found, (_path(each["loc"], given, missing=each["type"] == "missing") for each in found)
    )


def field_errors(
    errors: Iterable[Mapping[str, Any]], paths: Iterable[Iterable[str | int]]
) -> tuple[FieldError, ...]:
    """The invalid fields that the first of pydantic's ``errors`` are about, which are at these ``paths``."""
    found: dict[FieldError, None] = {}  # dependencies may share a parameter
    for error, path in islice(zip(errors, paths, strict=True), _MAX_FIELDS):
        found.update(dict.fromkeys(_fields(error, tuple(path))))
    return tuple(found)


def described(error: ValidationError, given: object) -> str:
    """What is wrong with ``given``, in a few sentences."""
    return _sentences(error.errors(include_url=False, include_input=False), given, ())


def summary(errors: Sequence[Mapping[str, Any]], fields: Sequence[FieldError]) -> str:
    """The first of ``errors``, which are about these ``fields``, as a sentence."""
    about = "" if errors[0]["type"] == OF_FIELDS else fields[0].field
    return sentence(about, fields[0].message)


def _sentences(errors: Sequence[ErrorDetails], given: object, known: Iterable[str]) -> str:
    sentences: dict[str, None] = {}
    for each in _of_the_sender(errors):
        fields = field_errors([each], [_path(each["loc"], given, missing=each["type"] == "missing")])
        text = summary([each], fields)
        unknown = each["type"] == "extra_forbidden" and "." not in fields[0].field
        similar = get_close_matches(fields[0].field, known, 1) if unknown else ()
        sentences[text + "".join(f" Did you mean `{name}`?" for name in similar)] = None
    more = len(sentences) - _MOST_SENTENCES
    return " ".join([*sentences][:_MOST_SENTENCES]) + (f" And {more} more." if more > 0 else "")


def _of_the_sender(errors: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """All but those of lists that are too short only because their wrong items do not count."""
    return [
        each
        for each in errors
        if each["type"] != "too_short"
        or not any(other["loc"][: len(each["loc"])] == each["loc"] for other in errors if other is not each)
    ]


def _fields(error: Mapping[str, Any], path: tuple[str | int, ...]) -> Iterator[FieldError]:
    """The invalid field at ``path``, or those of the object there that the error is about."""
    context = error.get("ctx", {})
    message = _short(plain_message(error["type"], error["msg"], context))
    inner = [(name,) for name in context["fields"]] if error["type"] == OF_FIELDS else [()]
    for names in inner:
        yield FieldError(_short(".".join(map(str, (*path, *names)))), message)


def _short(text: str) -> str:
    return text if len(text) <= _MAX_CHARACTERS else f"{text[:_MAX_CHARACTERS]}…"


def _path(location: Sequence[str | int], given: object, *, missing: bool) -> list[str | int]:
    """The path to a part of ``given``: pydantic's without the names of union members."""
    path: list[str | int] = []
    for part, following in pairwise((*location, None)):
        if isinstance(given, list | tuple) and isinstance(part, int):
            path.append(part)
            given = given[part] if part < len(given) else None
        elif isinstance(given, Mapping) and isinstance(part, str):
            inner = given.get(part)
            if following is None:
                wanted = missing or part in given
            else:
                inside_a_scalar = part in given and not missing and following not in given
                wanted = isinstance(inner, Mapping | list | tuple) or inside_a_scalar
            if wanted:
                path.append(part)
                given = inner
    return path


def plain_message(kind: str, message: str, context: Mapping[str, Any]) -> str:
    """What is wrong with a field: an error of pydantic's type ``kind``, with its ``message`` and context.

    See https://docs.pydantic.dev/latest/errors/validation_errors/ for types and contexts.
    """
    value, _, rest = kind.partition("_")
    if value in _VALUES and rest in _NOT_OF_ITS_TYPE:
        return f"it must be {_VALUES[value]}"
    if context.get("min_length") == 1:
        return "it must not be empty"
    if context.get("pattern") in FORMS:
        return FORMS[context["pattern"]]
    if kind not in _MESSAGES:
        return message
    text = _MESSAGES[kind].format_map({name: _shown(part) for name, part in context.items()})
    return text.replace(" 1 items", " 1 item").replace(" 1 characters", " 1 character")


def _shown(part: object) -> object:
    """A bound, without trailing zero decimals."""
    return int(part) if isinstance(part, float) and part.is_integer() else part


def sentence(field: str, message: str) -> str:
    """A sentence with ``message`` about ``field``, which is empty for the whole request."""
    message = message.removesuffix(".")
    if not field:
        return f"{_capital(message)}."
    for subject, verb in (("it ", " "), ("its ", "'s ")):
        if message.startswith(subject):
            return f"`{field}`{verb}{message.removeprefix(subject)}."
    return f"{field}: {message}."


def _capital(message: str) -> str:
    """The message with a capital first letter, unless it begins with a name, whose case must stay."""
    word = re.split(r"[\s,:]", message, maxsplit=1)[0]
    return message[:1].upper() + message[1:] if word.isalpha() else message
