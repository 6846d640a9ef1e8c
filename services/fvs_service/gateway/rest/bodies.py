"""JSON bodies: read after the caller is known, parsed and validated in a thread, at a bounded cost.

The interpreter's lock is held while C code parses, so a thread alone does not protect the event loop: the
parser takes a few nanoseconds per byte whatever the bytes are, and the number of values and the fields of an
object are limited, because each becomes a Python object, or an error.
"""

import asyncio
import codecs
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Annotated, Any, TypeVar

import anyio.to_thread
import orjson
from fastapi import Depends, Request
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect

from fvs_schema.base import Model
from fvs_schema.service import Limits
from fvs_service.errors import (
    InvalidRequestError,
    MalformedRequestError,
    SlowRequestError,
    UnsupportedMediaTypeError,
)
from fvs_service.gateway.rest.dependencies import Permission, application_of
from fvs_service.gateway.validation import invalid_body

ModelT = TypeVar("ModelT", bound=Model)

_BYTES_PER_VALUE = 64
"""Bytes per value in a body of the largest allowed size, which may thus have 23,437 values by default.
2,000 candidates have 20,000."""
_MAX_FIELDS = 64
_BLOCK_BYTES, _BLOCK_S = 262_144, 0.5
"""Size of a block, and the time after which it is shorter: what has not been written is lost in a crash."""
_SMALL_BYTES = 16_384
"""Smaller bodies are read before the caller is known, and parsed without a queue: both are cheap."""


def json_body(
    kind: type[ModelT], permission: Callable[..., Awaitable[Permission]]
) -> Callable[..., Awaitable[ModelT]]:
    """A dependency that reads the body as a ``kind`` for a caller who has the ``permission``.

    FastAPI would read, parse and validate a body on the event loop, before any dependency runs. One that is
    large is not even read before the permission is known.
    """
    received = unread_json_body(kind, permission)

    async def read(request: Request, require: Annotated[Permission, Depends(permission)]) -> ModelT:
        parsed = await received(request, require)

        def checked() -> ModelT:
            require()
            return parsed()

        return await anyio.to_thread.run_sync(checked)

    read.kind = kind  # type: ignore[attr-defined]  # for the OpenAPI document
    return read


def unread_json_body(
    kind: type[ModelT], permission: Callable[..., Awaitable[Permission]]
) -> Callable[..., Awaitable[Callable[[], ModelT]]]:
    """A dependency that gives a function, which reads the body in a thread that has checked the permission.

    For operations that check it in a thread anyway: ``json_body`` would take another one. As there, large
    bodies are received and parsed for a caller who has the ``permission``; the function then returns them.
    """

    async def receive(
        request: Request, require: Annotated[Permission, Depends(permission)]
    ) -> Callable[[], ModelT]:
        limits = application_of(request).storage.settings.limits
        if not _is_small(request):
            await anyio.to_thread.run_sync(require)
            content = await _received(request, _most_values(limits))
            one_at_a_time = request.app.state.parsing
            found = await anyio.to_thread.run_sync(parse, kind, content, limits, limiter=one_at_a_time)
            return lambda: found
        content = await request.body()

        def parsed() -> ModelT:
            _require_some(content)
            _require_json(request)
            return parse(kind, content, limits)

        return parsed

    receive.kind = kind  # type: ignore[attr-defined]  # for the OpenAPI document
    return receive


def _is_small(request: Request) -> bool:
    declared = request.headers.get("content-length", "")
    return declared.isdigit() and int(declared) <= _SMALL_BYTES


def parse(kind: type[ModelT], content: bytes, limits: Limits) -> ModelT:
    """The body as a ``kind``; raises ``MalformedRequestError`` and ``InvalidRequestError``.

    ``limits`` are the validation's context.
    """
    found = _validated(kind, _document(content, _most_values(limits)), limits)
    if isinstance(found, InvalidRequestError):
        raise found
    return found


def _validated(kind: type[ModelT], document: Any, limits: Limits) -> ModelT | InvalidRequestError:
    # The error is returned: raised here, its traceback would keep the document, which the event loop would
    # then have to free.
    try:
        return kind.model_validate(document, context={"limits": limits})
    except ValidationError as error:
        return invalid_body(error, document)


async def blocks(request: Request) -> AsyncGenerator[bytes, None]:
    """The body in blocks that are worth a call of a thread; those of a slow one, and the last, are shorter.

    What arrived before the client hung up, became too slow, or had to give way, comes before the exception.
    """
    stream, block, began = request.stream(), bytearray(), 0.0
    arriving = asyncio.ensure_future(anext(stream, None))
    try:
        while True:
            left_s = began + _BLOCK_S - time.monotonic() if block else None
            await asyncio.wait({arriving}, timeout=left_s)
            if arriving.done():
                chunk = arriving.result()
                if chunk is None:
                    break
                arriving = asyncio.ensure_future(anext(stream, None))
                began = began if block else time.monotonic()
                block += chunk
            if len(block) >= _BLOCK_BYTES or (block and time.monotonic() - began >= _BLOCK_S):
                yield bytes(block)
                block.clear()
    except (ClientDisconnect, SlowRequestError, asyncio.CancelledError):
        if block:
            yield bytes(block)
        raise
    finally:
        arriving.cancel()
        await asyncio.gather(arriving, return_exceptions=True)
    if block:
        yield bytes(block)


def declared_bytes(request: Request) -> int | None:
    """The declared size of the body, None without one; raises ``MalformedRequestError``."""
    declared = request.headers.get("content-length")
    if declared is None:
        return None
    if not (declared.isascii() and declared.isdigit()):
        raise MalformedRequestError(
            "Content-Length is not a number.", hint="Send the number of the body's bytes, in digits only."
        )
    return int(declared)


def has_body(headers: Headers) -> bool:
    """Whether a request carries a body."""
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers


def _most_values(limits: Limits) -> int:
    return limits.json_bytes // _BYTES_PER_VALUE


async def _received(request: Request, max_values: int) -> bytes:
    """The whole body; a wrong type is refused before it, too many values as soon as they have arrived."""
    content, commas = bytearray(), 0
    async for chunk in request.stream():
        if chunk and not content:
            _require_json(request)
        content += chunk
        commas += chunk.count(b",")
        _require_few(commas, max_values)
    _require_some(content)
    return bytes(content)


def _require_some(content: bytes | bytearray) -> None:
    if not content:
        raise InvalidRequestError("The body is empty.", hint="GET /openapi.json describes the request.")


def _require_few(commas: int, max_values: int) -> None:
    if commas >= max_values:
        raise InvalidRequestError(
            f"The body has more than {max_values} values.", hint="Split it into several requests."
        )


def _require_json(request: Request) -> None:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if not (kind.startswith("application/") and kind.endswith(("/json", "+json"))):
        raise UnsupportedMediaTypeError(
            f"The body is {kind[:100]}." if kind else "The body has no Content-Type.",
            hint="Send JSON with Content-Type: application/json.",
        )


def _document(content: bytes, max_values: int) -> Any:
    _require_few(content.count(b","), max_values)
    try:
        document = orjson.loads(content.removeprefix(codecs.BOM_UTF8))
    except orjson.JSONDecodeError as error:
        raise MalformedRequestError(
            f"The body is not JSON: {error.msg}, at character {error.pos}.",
            hint="See RFC 8259 for the syntax of JSON.",
        ) from None
    most = _most_fields(document)
    if most > _MAX_FIELDS:
        del document  # which the traceback would keep
        raise InvalidRequestError(
            f"The body has an object with {most} fields; {_MAX_FIELDS} are allowed.",
            hint="GET /openapi.json describes the request.",
        )
    return document


def _most_fields(document: Any) -> int:
    """The number of fields of the largest object."""
    most, pending = 0, [document]
    while pending:
        part = pending.pop()
        if isinstance(part, dict):
            most = max(most, len(part))
            pending += part.values()
        elif isinstance(part, list):
            pending += part
    return most
