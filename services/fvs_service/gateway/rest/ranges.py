"""Responses with ranges of immutable bytes: artifacts and original images."""

from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from typing import Annotated

from fastapi import Header
from fastapi.responses import Response, StreamingResponse

from fvs_service.errors import RangeError
from fvs_service.gateway.rest.conditions import has

RangeHeader = Annotated[
    str | None,
    Header(
        alias="Range",
        description="Which bytes to send; by default all. Of several ranges the whole is sent.",
        examples=["bytes=0-1023"],
    ),
]
IfRange = Annotated[
    str | None,
    Header(alias="If-Range", description="Send the range only of what has this ETag, else the whole."),
]


def ranged_response(
    sha256: str,
    size_bytes: int,
    media_type: str,
    read: Callable[[int, int], Iterator[bytes]],
    *,
    range_header: str | None,
    if_range: str | None,
    if_none_match: str | None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """The whole of some bytes (200), a range of them (206), or nothing when the caller has them (304).

    ``sha256`` is that of all bytes, and their ETag; ``read`` returns
    those from one position up to another. Raises what reading the first of them raises.
    """
    tag = f'"{sha256}"'
    sent = {"ETag": tag, "Accept-Ranges": "bytes", **(headers or {})}
    if has(sha256, if_none_match):
        return Response(status_code=304, headers=sent)
    span = byte_range(range_header, size_bytes) if if_range in (None, tag) else None
    start, stop = span or (0, size_bytes)
    sent["Content-Length"] = str(stop - start)
    if span is not None:
        sent["Content-Range"] = f"bytes {start}-{stop - 1}/{size_bytes}"
    content = _begun(read(start, stop))
    return StreamingResponse(content, 200 if span is None else 206, sent, media_type)


def _begun(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """The same chunks, the first one read now: if that fails, the response can still have an error status."""
    first = next(chunks, None)
    return iter(()) if first is None else chain((first,), chunks)


def byte_range(header: str | None, size: int) -> tuple[int, int] | None:
    """The first byte and the one after the last of a ``Range`` header; None for the whole artifact.

    Headers that are not a single range of bytes are ignored, as RFC 9110 (section 14.2) allows. Raises
    ``RangeError`` for a range that starts after the end.
    """
    unit, _, spec = (header or "").partition("=")
    first, dash, last = spec.strip().partition("-")
    if unit.strip() != "bytes" or not dash or not all(_is_number(part) for part in (first, last) if part):
        return None
    if not first:
        if not last:
            return None
        start, stop = max(0, size - int(last)), size
    else:
        start, stop = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return None
    if start >= size or stop <= start:
        raise RangeError(size)
    return start, stop


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 19
