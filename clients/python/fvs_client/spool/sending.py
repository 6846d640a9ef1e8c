"""Send one photograph until the service has acknowledged its digest."""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from fvs_client.spool.answers import DAMAGED, RefusedError, require_success
from fvs_client.spool.connection import Connection, UnreadableFileError
from fvs_client.spool.errors import LinkError
from fvs_client.spool.outbox import FILE_MISSING, Outbox
from fvs_client.spool.photograph import Photograph, Refusal
from fvs_client.spool.resumable import ResumableCarrier
from fvs_client.spool.taking import digest_of
from fvs_schema.masks import find_mask
from fvs_schema.videos import find_subtitles, is_video

_ACCEPTED = "accepted"
_USABLE = frozenset({_ACCEPTED, "duplicate", "video"})
_INVALID, _CONFLICT = "invalid-request", "conflict"
_SRT = {"Content-Type": "application/octet-stream"}
_CORRECT = "Correct its metadata, in its sidecar if it has one: then it is sent."


@dataclass(frozen=True)
class Acknowledgement:
    """The scene has the digest."""

    verdict: str
    refusal: Refusal | None = None
    """Why the image cannot be used."""
    mask: str | None = None
    """The digest of the mask that the image has."""


class Sender:
    """Sends photographs of an outbox."""

    def __init__(self, outbox: Outbox, connection: Connection, carrier: ResumableCarrier) -> None:
        self._outbox, self._connection, self._carrier = outbox, connection, carrier

    def send(self, photograph: Photograph) -> Refusal | None:
        """Send a photograph, and record in the outbox that it is sent, or refused; returns the reason.

        Raises ``LinkError``: try again; ``PutOffError``: send the next one first.
        """
        number = photograph.number
        try:
            found = self._sent(photograph)
            if found.verdict == _ACCEPTED:
                found = replace(found, refusal=self._refusal_of_mask(photograph, found.mask))
        except RefusedError as error:
            refusal = error.refusal
            if refusal.code == _INVALID and photograph.metadata:
                refusal = replace(refusal, hint=_CORRECT)
            self._outbox.refuse(number, refusal)
            return refusal
        except FileNotFoundError as error:
            _require_folder(photograph, error)
            refusal = Refusal(
                FILE_MISSING, f"{photograph.path} is gone.", "Put it back, then `fvs-client spool retry`."
            )
            self._outbox.refuse(number, refusal)
            return refusal
        except (UnreadableFileError, OSError) as error:
            _require_folder(photograph, error)
            refusal = Refusal(
                "file-unreadable",
                f"{photograph.path} cannot be read: {error}.",
                "Repair it, then `fvs-client spool retry`; `fvs-client spool add` sends it as it is now.",
            )
            self._outbox.refuse(number, refusal)
            return refusal
        if found.refusal is not None:
            self._outbox.refuse(number, found.refusal, found.verdict)
            return found.refusal
        self._outbox.acknowledge(number, found.verdict)
        return None

    def _sent(self, photograph: Photograph) -> Acknowledgement:
        """Send the bytes that the service does not have yet, and get its acknowledgement."""
        if self._outbox.was_sent(photograph.scene, photograph.digest):  # the same bytes under another name
            found = self._acknowledgement(photograph)
            if found is not None:
                return found
        with photograph.path.open("rb") as file:
            status = os.fstat(file.fileno())
            if (status.st_size, status.st_mtime_ns) != (photograph.size_bytes, photograph.mtime_ns):
                _require_content(photograph)
            try:
                self._send_subtitles(photograph)
                self._carrier.carry(photograph, file)
            except RefusedError as error:
                if error.refusal.code != DAMAGED:
                    raise
                _require_content(photograph)
                self._outbox.forget_upload(photograph.number)
                raise LinkError("Its bytes were damaged on the way.", answered=True) from error
        found = self._acknowledgement(photograph)
        if found is None:
            self._outbox.forget_upload(photograph.number)
            raise LinkError("The service has all bytes and does not have the image.", answered=True)
        return found

    def _refusal_of_mask(self, photograph: Photograph, present: str | None) -> Refusal | None:
        """Send the mask of an image that the scene has with the mask ``present``, if there is another one.

        Returns why the service will not take it.
        """
        file = find_mask(photograph.path.parent, photograph.path.name)
        if file is None:
            return None
        mask = file.read_bytes()
        if present == f"sha256:{hashlib.sha256(mask).hexdigest()}":
            return None
        path = f"/v1/scenes/{photograph.scene}/images/sha256:{photograph.digest}/mask"
        try:
            require_success(self._connection.ask("PUT", path, {"Content-Type": "image/png"}, mask))
        except RefusedError as error:
            reason = f"The scene has the photograph without its mask. {error.refusal.reason}"
            return replace(error.refusal, reason=reason)
        return None

    def _send_subtitles(self, photograph: Photograph) -> None:
        """Send what lies beside a video, and belongs to it, before its first byte."""
        beside = find_subtitles(photograph.path) if is_video(photograph.name) else None
        if beside is None or photograph.upload is not None:
            return
        path = f"/v1/scenes/{photograph.scene}/images/sha256:{photograph.digest}/subtitles"
        with contextlib.suppress(FileNotFoundError):
            content = beside.read_bytes()
            try:
                require_success(self._connection.ask("PUT", path, _SRT, content))
            except RefusedError as error:
                if error.refusal.code != _CONFLICT:  # the scene has the video
                    raise

    def _acknowledgement(self, photograph: Photograph) -> Acknowledgement | None:
        """Request the verdict on a digest; None when the scene does not have it."""
        digest = f"sha256:{photograph.digest}"
        answer = self._connection.ask(
            "POST",
            f"/v1/scenes/{photograph.scene}/images:check",
            {"Content-Type": "application/json"},
            json.dumps({"digests": [digest]}).encode(),
        )
        document = require_success(answer).document or {}
        if digest in document.get("missing", ()):
            return None
        for image in document.get("images", ()):
            verdict = image.get("verdict")
            if image.get("digest") == digest and isinstance(verdict, str):
                refusal = None if verdict in _USABLE else _refusal(verdict, image)
                return Acknowledgement(verdict, refusal, image.get("mask"))
        raise LinkError("The answer is not from an fvs service.", hint="Is the URL right?", answered=True)


def _refusal(verdict: str, image: Mapping[str, Any]) -> Refusal:
    return Refusal(verdict, str(image.get("reason") or verdict), str(image.get("hint") or ""))


def _require_folder(photograph: Photograph, error: Exception) -> None:
    """Raise ``LinkError`` where a card was taken out: its photographs wait for it."""
    folder = photograph.path.parent
    if not folder.exists():
        raise LinkError(f"{folder} is not there.", hint="Is the card in its place?") from error


def _require_content(photograph: Photograph) -> None:
    if digest_of(photograph.path) != photograph.digest:
        raise UnreadableFileError("it has other content than when it was added")
