"""Pydantic's messages about wrong input, said plainly: "it must …", of which the subject is the field."""

import re
from collections.abc import Callable

from fvs_service.images.model import IMAGE_NAME
from fvs_service.model import DIGEST
from fvs_service.rankings.model import CANDIDATE_ID, VEHICLE_NAME
from fvs_service.scenes.model import SCENE_NAME

_VALIDATOR = "Value error, "
"""Pydantic's prefix of the messages of our validators."""
_KINDS = {
    "extra_forbidden": "there is no such field",
    "missing": "it is missing",
    "union_tag_not_found": "its kind is missing",
}
_NAME = "letters, digits and . _ ~ : @ + -, of which the first is a letter or a digit"
_FORMS = {
    CANDIDATE_ID: f"it must be 1 to 128 {_NAME}",
    VEHICLE_NAME: f"it must be 1 to 64 {_NAME}",
    DIGEST: "it must be sha256: and 64 lower-case hexadecimal digits",
    IMAGE_NAME: "it must not have slashes, backslashes or control characters",
    SCENE_NAME: "it must not have control characters",
}
"""What strings of these patterns are."""
_LONGEST = 2_000
"""A longer message repeats what was sent."""
_VALUES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "a string",
    "boolean": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dictionary": "an object",
    "datetime": "a time, as in RFC 3339",
}


def _items(found: re.Match[str]) -> str:
    """For a list that is too short or too long."""
    bound, most, had = found[1], found[2], found[3]
    if (bound, most) == ("least", "1"):
        return "it must not be empty"
    return f"it must have at {bound} {most} items; it has {had}"


def _length(found: re.Match[str]) -> str:
    """For a string that is too short or too long."""
    if found[2] == "1" and found[1] == "least":
        return "it must not be empty"
    return f"it must have at {found[1]} {found[2]} character{'s' * (found[2] != '1')}"


_RULES: tuple[tuple[re.Pattern[str], Callable[[re.Match[str]], str]], ...] = tuple(
    (re.compile(pattern, re.DOTALL), said)
    for pattern, said in (
        (r"Input should be greater than or equal to (\S+)", lambda found: f"it must be at least {found[1]}"),
        (r"Input should be less than or equal to (\S+)", lambda found: f"it must be at most {found[1]}"),
        (r"Input should be greater than (\S+)", lambda found: f"it must be more than {found[1]}"),
        (r"Input should be less than (\S+)", lambda found: f"it must be less than {found[1]}"),
        (r"Input should be a finite number", lambda _: "it must be a finite number"),
        (r"Input should have timezone info", lambda _: "it must have a time zone"),
        (
            rf"Input should be an? valid ({'|'.join(_VALUES)})\b.*",
            lambda found: f"it must be {_VALUES[found[1]]}",
        ),
        (r"Input should be ('.*)", lambda found: f"it must be {found[1]}"),
        (r"\w+ should have at (least|most) (\d+) items? after validation, not (.+)", _items),
        (r"String should have at (least|most) (\d+) characters?", _length),
        (
            r"String should match pattern '(.*)'",
            lambda found: _FORMS.get(found[1], f"it must match the pattern {found[1]}"),
        ),
        (
            r"Input tag '.*' found using '(\w+)' does not match any of the expected tags: (.*)",
            lambda found: f"its {found[1]} must be one of {found[2]}",
        ),
    )
)


def plain_message(kind: str, message: str) -> str:
    """What is wrong with a field: pydantic's ``message`` of this ``kind``, or a validator's own words."""
    if kind in _KINDS:
        return _KINDS[kind]
    if message.startswith(_VALIDATOR):
        return message.removeprefix(_VALIDATOR)
    for pattern, said in _RULES if len(message) <= _LONGEST else ():
        if (found := pattern.fullmatch(message)) is not None:
            return said(found)
    return message


def sentence(field: str, message: str) -> str:
    """The sentence that says ``message`` of ``field``, which is empty for the whole request."""
    if not field:
        return f"{_capital(message)}."
    for subject, verb in (("it ", " "), ("its ", "'s ")):
        if message.startswith(subject):
            return f"`{field}`{verb}{message.removeprefix(subject)}."
    return f"{field}: {message}."


def _capital(message: str) -> str:
    """The beginning of a sentence in capitals, unless that is a name, which would become another one."""
    word = re.split(r"[\s,:]", message, maxsplit=1)[0]
    return message[:1].upper() + message[1:] if word.isalpha() else message
