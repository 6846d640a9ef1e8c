"""Conditional requests (RFC 9110, section 13): the tags that a client names."""

import re
from typing import Annotated

from fastapi import Depends, Header, Response

from fvs_schema.error_codes import FieldError
from fvs_service.errors import InvalidRequestError

_TAG = re.compile(r'(W/)?"([\x21\x23-\x7e\x80-\xff]*)"')
_TAGS = re.compile(rf"\s*({_TAG.pattern}\s*(,\s*|$))+")
_ANY = "*"

IfNoneMatch = Annotated[
    str | None, Header(alias="If-None-Match", description="Send nothing if one of these is the ETag.")
]


def has(tag: str, if_none_match: str | None) -> bool:
    """Whether a client has what has this tag already."""
    given = (if_none_match or "").strip()
    return given == _ANY or any(found[2] == tag for found in _TAG.finditer(given))


async def _expected(
    if_match: Annotated[
        str | None,
        Header(
            alias="If-Match",
            description="Do it only if one of these is the ETag; else 412 `precondition-failed`: it has "
            "changed since.",
        ),
    ] = None,
) -> frozenset[str] | None:
    if if_match is None or if_match.strip() == _ANY:
        return None
    if not _TAGS.fullmatch(if_match):
        wrong = FieldError("If-Match", "it is not a list of ETags in quotes")
        raise InvalidRequestError(
            f"{wrong.field}: {wrong.message}.",
            hint="Send the ETag of the response as it came.",
            errors=(wrong,),
        )
    # Weak tags never match: they say that something is good enough, not that it is the same.
    return frozenset(found[2] for found in _TAG.finditer(if_match) if not found[1])


Expected = Annotated[frozenset[str] | None, Depends(_expected)]
"""The tags of which the resource must have one; None for any."""


def set_tag(response: Response, tag: str) -> None:
    """Tell the tag of what is returned."""
    response.headers["ETag"] = f'"{tag}"'


def not_modified(tag: str) -> Response:
    """The response to who has what has this tag already."""
    response = Response(status_code=304)
    set_tag(response, tag)
    return response
