"""Send a photograph piece by piece, each from the offset that the service has: tus 1.0.0."""

import base64
from collections.abc import Callable, Mapping
from typing import BinaryIO

from fvs_client.spool.answers import Answer, require_success
from fvs_client.spool.connection import Connection, Part
from fvs_client.spool.errors import LinkError
from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import Photograph, State
from fvs_client.spool.pieces import Pieces

_UPLOADS = "/v1/uploads"
_VERSION = {"Tus-Resumable": "1.0.0"}
_BODY = {"Content-Type": "application/offset+octet-stream"}
_GONE = frozenset({404, 410})
_OTHER_OFFSET = 409


class PutOffError(Exception):
    """A more urgent photograph goes first; this one resumes later."""


class ResumableCarrier:
    """Brings photographs to the service by resumable uploads.

    The first piece goes with the request that creates the upload. After a failure that request, or ``HEAD``,
    gets the offset before a byte is sent.
    """

    def __init__(
        self, connection: Connection, outbox: Outbox, puts_off: Callable[[Photograph], bool]
    ) -> None:
        self._connection, self._outbox = connection, outbox
        self._puts_off = puts_off
        self._pieces = Pieces()

    def carry(self, photograph: Photograph, file: BinaryIO) -> None:
        """Send what the service lacks.

        Raises ``LinkError``, ``RefusedError``, ``UnreadableFileError``; between two pieces ``PutOffError``.
        """
        upload, offset = photograph.upload, self._offset(photograph)
        if offset is None:
            upload, offset = self._create(photograph, file)
        while offset < photograph.size_bytes:
            if self._puts_off(photograph):
                raise PutOffError
            offset = self._append(photograph, upload, offset, file)

    def _offset(self, photograph: Photograph) -> int | None:
        """The number of bytes received; None if the upload does not exist or has expired."""
        if photograph.upload is None:
            return None
        answer = self._connection.ask("HEAD", f"{_UPLOADS}/{photograph.upload}", _VERSION)
        if answer.status in _GONE:  # expired; creating it tells whether it was the service that said so
            self._outbox.forget_upload(photograph.number)
            return None
        return self._confirmed(photograph, require_success(answer))

    def _create(self, photograph: Photograph, file: BinaryIO) -> tuple[str, int]:
        """Create an upload, or find that of the same image to resume; returns its id and offset."""
        fresh = photograph.state is State.WAITING
        self._outbox.begin(photograph.number, None)
        headers = {
            **_VERSION,
            "Upload-Length": str(photograph.size_bytes),
            "Upload-Metadata": _metadata(photograph),
        }
        body: Part | bytes = b""
        if fresh:
            body, headers = self._piece(photograph, 0, file), {**headers, **_BODY}
        answer = require_success(self._ask("POST", _UPLOADS, headers, body))
        # Only the id: where a proxy leads to the service, its addresses are others than ours.
        upload = answer.headers.get("location", "").rstrip("/").rpartition("/")[2]
        if not upload:
            raise _not_the_service()
        self._outbox.begin(photograph.number, upload)
        return upload, self._confirmed(photograph, answer)

    def _append(self, photograph: Photograph, upload: str | None, offset: int, file: BinaryIO) -> int:
        """Send a piece; the offset after it."""
        headers = {**_VERSION, **_BODY, "Upload-Offset": str(offset)}
        body = self._piece(photograph, offset, file)
        answer = self._ask("PATCH", f"{_UPLOADS}/{upload}", headers, body)
        if answer.status in _GONE:
            self._outbox.forget_upload(photograph.number)
            raise LinkError("The upload is gone; it begins anew.", answered=True)
        if answer.status == _OTHER_OFFSET:  # an earlier request arrived further than we knew
            raise LinkError("The service has another offset.", answered=True)
        after = self._confirmed(photograph, require_success(answer))
        if after <= offset:
            raise LinkError("The service took no bytes.", answered=True)
        return after

    def _ask(self, method: str, path: str, headers: Mapping[str, str], body: Part | bytes) -> Answer:
        answer = self._connection.ask(method, path, headers, body)
        if answer.early:
            self._pieces.stopped()
        return answer

    def _piece(self, photograph: Photograph, offset: int, file: BinaryIO) -> Part:
        size = self._pieces.begin(photograph.number, offset, photograph.size_bytes - offset)
        return Part(file, offset, size, self._pieces.sent)

    def _confirmed(self, photograph: Photograph, answer: Answer) -> int:
        """Record the offset in an answer."""
        text = answer.headers.get("upload-offset", "")
        if not (text.isascii() and text.isdigit()) or int(text) > photograph.size_bytes:
            raise _not_the_service()
        self._pieces.arrived(photograph.number, int(text))
        self._outbox.confirm(photograph.number, int(text))
        return int(text)


def _metadata(photograph: Photograph) -> str:
    """``Upload-Metadata``: names, and values in base64."""
    fields = {
        "scene": photograph.scene,
        "sha256": photograph.digest,
        "filename": photograph.name,
        **photograph.metadata,
    }
    return ",".join(
        f"{name} {base64.b64encode(str(value).encode()).decode()}" for name, value in fields.items()
    )


def _not_the_service() -> LinkError:
    return LinkError(
        "The answer is not from an fvs service.",
        hint="Is the URL right, and is the service new enough for resumable uploads?",
        answered=True,
    )
