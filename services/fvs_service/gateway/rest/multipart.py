"""Streaming ``multipart/form-data``: each file is staged while its bytes arrive, and yielded at its end.

No file is kept in memory, and files that arrived before the connection broke are not lost.
"""

import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass

import anyio.to_thread
from python_multipart import MultipartParser
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import parse_options_header
from starlette.requests import Request

from fvs_schema.masks import is_mask
from fvs_schema.names import readable_name
from fvs_service.errors import InvalidRequestError, MalformedRequestError, UnsupportedMediaTypeError
from fvs_service.gateway.rest.bodies import blocks
from fvs_service.images.upload_files import Receiver, StagedFile
from fvs_service.images.uploads import Uploads
from fvs_service.uninterrupted import to_its_end

_MAX_HEADER_BYTES = 8_192
_MAX_HEADERS = 16
"""Maximum number of headers of one part of the form."""


@dataclass(frozen=True)
class UploadedFile:
    """One file of a form; ``is_mask``: the mask of an image, not an image."""

    name: str
    staged: StagedFile
    is_mask: bool


async def receive_files(
    request: Request, uploads: Uploads, max_files: int, parsing: anyio.CapacityLimiter
) -> AsyncIterator[UploadedFile]:
    """The files of a form; each is deleted before the next one, unless it was moved into the blobs.

    Masks, parts called ``mask`` or files in a folder of masks, come after all images.
    ``parsing`` limits the threads that parse: the parser is in Python, and many at a time would keep the
    interpreter from the event loop.

    Raises ``UnsupportedMediaTypeError`` for another kind of body, ``MalformedRequestError`` for a broken one,
    ``InvalidRequestError`` for too many files and for parts that are not files.
    """
    kind, options = parse_options_header(request.headers.get("content-type"))
    if kind != b"multipart/form-data" or b"boundary" not in options:
        raise UnsupportedMediaTypeError(
            "The body is not multipart/form-data.", hint="Send a form, as in curl -F file=@photograph.jpg."
        )
    parts = _Parts(uploads, max_files)
    try:
        parser = MultipartParser(options[b"boundary"], parts.callbacks())  # type: ignore[arg-type]
        async with contextlib.aclosing(blocks(request)) as body:
            async for block in body:
                writing = anyio.to_thread.run_sync(parser.write, block, limiter=parsing)
                await to_its_end(writing)  # also opens files, which nobody would delete
                while parts.complete:
                    receiver, file = parts.complete.pop(0)
                    with receiver:
                        yield file
        if not parts.ended:
            raise MalformedRequestError(
                "The form is cut off.", hint="End it with its boundary and two hyphens (RFC 2046)."
            )
        while parts.masks:
            receiver, file = parts.masks.pop(0)
            with receiver:
                yield file
    except FormParserError as error:
        raise MalformedRequestError(
            "The form is broken.", hint="RFC 7578 describes forms; curl -F file=@photograph.jpg sends one."
        ) from error
    finally:
        parts.close()


class _Parts:
    """The state of the form between chunks."""

    def __init__(self, uploads: Uploads, max_files: int) -> None:
        self._uploads, self._max_files = uploads, max_files
        self._field, self._value, self._headers = b"", b"", 0
        self._disposition: bytes | None = None
        self._name, self._is_mask = "", False
        self._receiver: Receiver | None = None
        self._count = 0
        self.ended = False
        self.complete: list[tuple[Receiver, UploadedFile]] = []
        self.masks: list[tuple[Receiver, UploadedFile]] = []

    def callbacks(self) -> dict[str, object]:
        """The parser's callbacks."""
        return {
            "on_part_begin": self._begin,
            "on_header_field": self._header_field,
            "on_header_value": self._header_value,
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_part_data": self._data,
            "on_part_end": self._end,
            "on_end": self._end_form,
        }

    def close(self) -> None:
        """Delete the files that are incomplete or were not yielded."""
        left = [receiver for receiver, _ in self.complete + self.masks]
        for receiver in left + ([self._receiver] if self._receiver else []):
            with receiver:
                pass

    def _begin(self) -> None:
        self._field, self._value, self._disposition = b"", b"", None
        self._headers = 0

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._field = self._bounded(self._field + data[start:end])

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value = self._bounded(self._value + data[start:end])

    def _header_end(self) -> None:
        self._headers += 1
        if self._headers > _MAX_HEADERS:
            raise MalformedRequestError(
                "A part of the form has too many headers.",
                hint="Send only Content-Disposition and Content-Type.",
            )
        if self._field.lower() == b"content-disposition":
            self._disposition = self._value
        self._field, self._value = b"", b""

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        if b"filename" not in options:
            raise InvalidRequestError("The form has a part that is not a file.", hint="Send only files.")
        self._count += 1
        if self._count > self._max_files:
            raise InvalidRequestError(
                f"The form has more than {self._max_files} files.", hint="Send them in several requests."
            )
        self._name = readable_name(options[b"filename"].decode("utf-8", errors="surrogateescape"))
        self._is_mask = options.get(b"name") == b"mask" or is_mask(self._name.replace("\\", "/"))
        self._receiver = self._uploads.receive()

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._receiver is not None:
            self._receiver.write(data[start:end])

    def _end(self) -> None:
        if self._receiver is not None:
            file = UploadedFile(self._name, self._receiver.finish(), self._is_mask)
            (self.masks if file.is_mask else self.complete).append((self._receiver, file))
            self._receiver = None

    def _end_form(self) -> None:
        self.ended = True

    @staticmethod
    def _bounded(value: bytes) -> bytes:
        if len(value) > _MAX_HEADER_BYTES:
            raise MalformedRequestError(
                "A header of the form is too long.", hint="Shorten the names of the files."
            )
        return value
