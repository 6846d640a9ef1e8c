"""Sending images: only those that the scene does not have, several at a time, each with its verdict.

What was sent stays sent, so an upload that was broken off is taken up by doing it again.
"""

import hashlib
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fvs_client import requests
from fvs_client.effects import FileBody, Operation, call, together
from fvs_client.errors import ForbiddenError, FvsError, NotFoundError, UnauthenticatedError
from fvs_client.exchange import exchange, parse
from fvs_client.models.base import Word
from fvs_client.models.images import DigestAnswer, Image, ImageMetadata
from fvs_client.operations.listing import Page
from fvs_client.operations.photographs import Paths, Photograph, find_photographs
from fvs_client.retries import Retries

Describe = Callable[[Path], ImageMetadata | None]

_BATCH = 256
"""So many images are read, asked for and sent before the next are looked at."""
_MOST_KNOWN = 8
"""Verdicts of more images that were there already are read from the scene's list."""
_HASH_BYTES = 1 << 20


class Outcome(Word):
    """What became of a file."""

    SENT = "sent"
    ALREADY_THERE = "already-there"
    FAILED = "failed"


@dataclass(frozen=True)
class UploadedFile:
    """One file of an upload.

    ``image`` has the service's verdict; it is None when the file failed (``error`` says why), and when the
    scene had it and the API key may not read.
    """

    path: Path
    outcome: Outcome
    digest: str | None = None
    image: Image | None = None
    error: Exception | None = None


@dataclass(frozen=True)
class UploadReport:
    """What became of the files of an upload, in their order."""

    files: tuple[UploadedFile, ...]
    bytes_sent: int

    @property
    def sent(self) -> tuple[UploadedFile, ...]:
        """The files whose bytes were sent."""
        return self._with(Outcome.SENT)

    @property
    def already_there(self) -> tuple[UploadedFile, ...]:
        """The files that the scene had, whose bytes were not sent."""
        return self._with(Outcome.ALREADY_THERE)

    @property
    def failed(self) -> tuple[UploadedFile, ...]:
        """The files that are not in the scene."""
        return self._with(Outcome.FAILED)

    @property
    def rejected(self) -> tuple[UploadedFile, ...]:
        """The files that are in the scene and cannot be used; ``image`` has verdict, reason and hint."""
        return tuple(file for file in self.files if file.image is not None and not file.image.accepted)

    @property
    def ok(self) -> bool:
        """Whether every file arrived and can be used."""
        return not self.failed and not self.rejected

    def _with(self, outcome: Outcome) -> tuple[UploadedFile, ...]:
        return tuple(file for file in self.files if file.outcome is outcome)


@dataclass(frozen=True)
class UploadProgress:
    """How far an upload is; ``bytes_done`` counts also what need not be sent, ``bytes_sent`` what went."""

    files_done: int
    files_total: int
    bytes_done: int
    bytes_total: int
    bytes_sent: int
    last: UploadedFile | None = None
    """The file that was finished last."""


@dataclass(frozen=True)
class Sending:
    """Where images go, and how."""

    scene_id: str
    parallel: int
    retries: Retries
    describe: Describe | None
    session: object


@dataclass(frozen=True)
class _Known:
    """A file whose content has been read."""

    photograph: Photograph
    digest: str
    size_bytes: int


class _Tally:
    """Counts, from whichever thread, and tells one at a time."""

    def __init__(
        self, files: Sequence[Photograph], on_progress: Callable[[UploadProgress], object] | None
    ) -> None:
        total = sum(_size(file.path) for file in files)
        self._lock = threading.Lock()
        self._on_progress = on_progress
        self.progress = UploadProgress(0, len(files), 0, total, 0)
        self._tell()

    def went(self, size: int) -> None:
        """So many bytes went out (negative: and have to go again)."""
        with self._lock:
            now = self.progress
            self.progress = replace(
                now, bytes_done=now.bytes_done + size, bytes_sent=now.bytes_sent + max(0, size)
            )
            self._tell()

    def finished(self, file: UploadedFile, unsent_bytes: int = 0) -> None:
        """A file is done; ``unsent_bytes`` of it did not have to be sent."""
        with self._lock:
            now = self.progress
            self.progress = replace(
                now, files_done=now.files_done + 1, bytes_done=now.bytes_done + unsent_bytes, last=file
            )
            self._tell()

    def _tell(self) -> None:
        if self._on_progress is not None:
            self._on_progress(self.progress)


def upload(
    paths: Paths,
    sending: Sending,
    on_progress: Callable[[UploadProgress], object] | None,
) -> Operation[UploadReport]:
    """Send what the scene does not have.

    A file that cannot be read or is refused is reported and does not stop the others. What would fail for
    every file raises: a service that does not answer, a key that is not good, a scene that does not exist.
    """
    photographs = yield from call(lambda: find_photographs(paths))
    tally = yield from call(lambda: _Tally(photographs, on_progress))
    done: dict[Path, UploadedFile] = {}
    for start in range(0, len(photographs), _BATCH):
        yield from _send_batch(photographs[start : start + _BATCH], sending, tally, done)
    verdicts = yield from _verdicts(done.values(), sending)
    files = tuple(
        replace(file, image=file.image or verdicts.get(file.digest or ""))
        for file in (done[photograph.path] for photograph in photographs)
    )
    return UploadReport(files, tally.progress.bytes_sent)


def _send_batch(
    photographs: Sequence[Photograph], sending: Sending, tally: _Tally, done: dict[Path, UploadedFile]
) -> Operation[None]:
    for photograph in photographs:
        if not photograph.readable:
            done[photograph.path] = _unreadable(photograph)
            tally.finished(done[photograph.path], _size(photograph.path))
    photographs = [photograph for photograph in photographs if photograph.readable]
    read = yield from together((_read(photograph) for photograph in photographs), sending.parallel)
    to_send: dict[str, _Known] = {}
    again: list[_Known] = []
    for photograph, found in zip(photographs, read, strict=True):
        if isinstance(found, OSError):
            done[photograph.path] = UploadedFile(photograph.path, Outcome.FAILED, error=found)
            tally.finished(done[photograph.path])
        elif to_send.setdefault(found.digest, found) is not found:
            again.append(found)
    if to_send:
        reply = yield from exchange(requests.check_images(sending.scene_id, to_send), sending.retries)
        answer = parse(DigestAnswer, reply.content, sending.session)
        again += [to_send.pop(digest) for digest in answer.known if digest in to_send]
    sent = yield from together((_send(file, sending, tally) for file in to_send.values()), sending.parallel)
    done.update((file.path, file) for file in sent)
    failed = {file.digest: file for file in sent if file.outcome is Outcome.FAILED}
    for file in again:
        twin = failed.get(file.digest)  # the same bytes under another name share their fate
        path = file.photograph.path
        done[path] = (
            UploadedFile(path, Outcome.ALREADY_THERE, file.digest)
            if twin is None
            else replace(twin, path=path)
        )
        tally.finished(done[path], file.size_bytes)


def _unreadable(photograph: Photograph) -> UploadedFile:
    error = FvsError(
        f"The service does not read {photograph.path.suffix[1:].upper()} files.",
        hint="Export it as JPEG or PNG.",
    )
    return UploadedFile(photograph.path, Outcome.FAILED, error=error)


def _read(photograph: Photograph) -> Operation[_Known | OSError]:
    def read() -> _Known | OSError:
        digest, size = hashlib.sha256(), 0
        try:
            with photograph.path.open("rb") as file:
                while chunk := file.read(_HASH_BYTES):
                    digest.update(chunk)
                    size += len(chunk)
        except OSError as error:
            return error
        return _Known(photograph, f"sha256:{digest.hexdigest()}", size)

    return (yield from call(read))


def _send(file: _Known, sending: Sending, tally: _Tally) -> Operation[UploadedFile]:
    path = file.photograph.path
    own = None if sending.describe is None else sending.describe(path)
    metadata = (own or ImageMetadata()).model_copy(
        update={"name": (own.name if own else None) or file.photograph.name}
    )
    body = FileBody(path, file.size_bytes, tally.went)
    request = requests.put_image(sending.scene_id, file.digest, body, metadata)
    try:
        reply = yield from exchange(request, sending.retries)
    except (UnauthenticatedError, ForbiddenError, NotFoundError):
        raise
    except (FvsError, OSError) as error:
        failed = UploadedFile(path, Outcome.FAILED, file.digest, error=error)
        tally.finished(failed)
        return failed
    image = parse(Image, reply.content, sending.session)
    sent = UploadedFile(path, Outcome.SENT, file.digest, image)
    tally.finished(sent)
    return sent


def _verdicts(files: Iterable[UploadedFile], sending: Sending) -> Operation[Mapping[str, Image]]:
    """Images that were there already, by digest; none when the key may only send."""
    wanted = {file.digest for file in files if file.outcome is Outcome.ALREADY_THERE and file.digest}
    try:
        if len(wanted) <= _MOST_KNOWN:
            operations = [_show(digest, sending) for digest in sorted(wanted)]
            images = yield from together(operations, sending.parallel)
        else:
            images = yield from _list(sending)
    except ForbiddenError:
        return {}
    return {image.digest: image for image in images if image.digest in wanted}


def _show(digest: str, sending: Sending) -> Operation[Image]:
    reply = yield from exchange(requests.get_image(sending.scene_id, digest), sending.retries)
    return parse(Image, reply.content, sending.session)


def _list(sending: Sending) -> Operation[list[Image]]:
    images: list[Image] = []
    after: str | None = None
    while True:
        request = requests.list_of(requests.images_of(sending.scene_id), after, 1000)
        page = parse(Page[Image], (yield from exchange(request, sending.retries)).content, sending.session)
        images += page.items
        if page.next is None:
            return images
        after = page.next


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def put(content: bytes, metadata: ImageMetadata | None, sending: Sending) -> Operation[Image]:
    """Send one image from memory."""
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    request = requests.put_image(sending.scene_id, digest, content, metadata)
    return parse(Image, (yield from exchange(request, sending.retries)).content, sending.session)
