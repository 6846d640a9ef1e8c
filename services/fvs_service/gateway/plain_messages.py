"""Plain messages for pydantic's errors: "it must …", with the field as the subject."""

import re
from collections.abc import Mapping
from typing import Any

from fvs_service.images.model import IMAGE_NAME
from fvs_service.model import DIGEST
from fvs_service.rankings.model import CANDIDATE_ID, VEHICLE_NAME
from fvs_service.scenes.model import SCENE_NAME

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
_NAME = "letters, digits and . _ ~ : @ + -, of which the first is a letter or a digit"
_FORMS = {
    CANDIDATE_ID: f"it must be 1 to 128 {_NAME}",
    VEHICLE_NAME: f"it must be 1 to 64 {_NAME}",
    DIGEST: "it must be sha256: and 64 lower-case hexadecimal digits",
    IMAGE_NAME: "it must not have slashes, backslashes or control characters",
    SCENE_NAME: "it must not have control characters",
}
"""By the pattern that a string does not match."""


def plain_message(kind: str, message: str, context: Mapping[str, Any]) -> str:
    """What is wrong with a field: an error of pydantic's type ``kind``, with its ``message`` and context.

    See https://docs.pydantic.dev/latest/errors/validation_errors/ for types and contexts.
    """
    value, _, rest = kind.partition("_")
    if value in _VALUES and rest in _NOT_OF_ITS_TYPE:
        return f"it must be {_VALUES[value]}"
    if context.get("min_length") == 1:
        return "it must not be empty"
    if context.get("pattern") in _FORMS:
        return _FORMS[context["pattern"]]
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
