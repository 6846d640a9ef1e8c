"""``multipart/form-data`` as it arrives: each file goes to disk as its bytes come.

It is handed on when it is whole. Nothing is kept in memory, and what arrived before a connection broke is
not lost.
"""

from collections.abc import AsyncIterator
from dataclasses import dataclass

from python_multipart import MultipartParser
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import parse_options_header
from starlette.requests import Request

from fvs_service.errors import InvalidRequestError, MalformedRequestError, UnsupportedMediaTypeError
from fvs_service.images.staging import Receiver, StagedFile, StagingArea

_MOST_HEADER_BYTES = 8_192


@dataclass(frozen=True)
class UploadedFile:
    """One file of a form."""

    name: str
    staged: StagedFile


async def receive_files(
    request: Request, staging: StagingArea, most_files: int
) -> AsyncIterator[UploadedFile]:
    """The files of a form, one after the other; each is deleted when the next is asked for, unless adopted.

    Parts that are no files are refused. Raises ``UnsupportedMediaTypeError`` for another kind of body,
    ``MalformedRequestError`` for a broken one, ``InvalidRequestError`` for too many files.
    """
    kind, options = parse_options_header(request.headers.get("content-type"))
    if kind != b"multipart/form-data" or b"boundary" not in options:
        raise UnsupportedMediaTypeError(
            "The body is not multipart/form-data.", hint="curl -F file=@photograph.jpg does it."
        )
    parts = _Parts(staging, most_files)
    try:
        parser = MultipartParser(options[b"boundary"], parts.callbacks())  # type: ignore[arg-type]
        async for chunk in request.stream():
            parser.write(chunk)
            while parts.whole:
                receiver, file = parts.whole.pop(0)
                with receiver:
                    yield file
        if not parts.ended:
            raise MalformedRequestError("The form is cut off.", hint="Send it again.")
    except FormParserError as error:
        raise MalformedRequestError("The form is broken.", hint="Send it again.") from error
    finally:
        parts.close()


class _Parts:
    """The state of the form between chunks."""

    def __init__(self, staging: StagingArea, most_files: int) -> None:
        self._staging, self._most_files = staging, most_files
        self._field, self._value = b"", b""
        self._disposition: bytes | None = None
        self._name = ""
        self._receiver: Receiver | None = None
        self._begun = 0
        self.ended = False
        self.whole: list[tuple[Receiver, UploadedFile]] = []

    def callbacks(self) -> dict[str, object]:
        """What the parser calls."""
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
        """Delete what did not become whole, or was not asked for."""
        for receiver in [receiver for receiver, _ in self.whole] + (
            [self._receiver] if self._receiver else []
        ):
            with receiver:
                pass

    def _begin(self) -> None:
        self._field, self._value, self._disposition = b"", b"", None

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._field = self._bounded(self._field + data[start:end])

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value = self._bounded(self._value + data[start:end])

    def _header_end(self) -> None:
        if self._field.lower() == b"content-disposition":
            self._disposition = self._value
        self._field, self._value = b"", b""

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        if b"filename" not in options:
            raise InvalidRequestError("The form has a part that is no file.", hint="Send only files.")
        self._begun += 1
        if self._begun > self._most_files:
            raise InvalidRequestError(
                f"The form has more than {self._most_files} files.", hint="Send them in several requests."
            )
        self._name = options[b"filename"].decode("utf-8", errors="replace")
        self._receiver = self._staging.receive(None)

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._receiver is not None:
            self._receiver.write(data[start:end])

    def _end(self) -> None:
        if self._receiver is not None:
            self.whole.append((self._receiver, UploadedFile(self._name, self._receiver.finish())))
            self._receiver = None

    def _end_form(self) -> None:
        self.ended = True

    @staticmethod
    def _bounded(value: bytes) -> bytes:
        if len(value) > _MOST_HEADER_BYTES:
            raise MalformedRequestError("A header of the form is too long.")
        return value
