"""Uploads over gRPC: a stream that begins with a description of the image, followed by its bytes."""

import contextlib
from collections.abc import Awaitable, Callable

from anyio.to_thread import run_sync
from fvs.v1 import images_pb2 as pb
from google.protobuf.message import Message

from fvs_schema.images import Image, ImageMetadata
from fvs_service.application import Application
from fvs_service.errors import InvalidRequestError, MalformedRequestError, OutOfSpaceError
from fvs_service.gateway.rpc.calls import parsed
from fvs_service.gateway.rpc.conversion import pick, read, write
from fvs_service.gateway.upload_pace import UploadPace
from fvs_service.images.partial_uploads import NewUpload
from fvs_service.images.staging import Receiver, require_digest
from fvs_service.principal import Principal, Scope
from fvs_service.telemetry import Metrics
from fvs_service.uninterrupted import to_its_end

_SMALL_CHUNK_BYTES, _FREE_CHUNKS = 64, 256
"""A stream may have this many chunks of any size; beyond that, the mean size is checked, as over HTTP."""


class ImageUpload:
    """One upload; ``receive`` returns the bytes of the next message, None after the last.

    ``name`` is called with the message that names the scene.
    """

    def __init__(
        self,
        app: Application,
        metrics: Metrics,
        caller: Principal,
        receive: Callable[[], Awaitable[bytes | None]],
        name: Callable[[Message], object],
    ) -> None:
        self._app, self._metrics, self._caller = app, metrics, caller
        self._receive, self._name = receive, name
        self._pace = UploadPace(app.storage.settings)
        self._messages = self._received_bytes = 0

    async def run(self) -> pb.UploadImageResponse:
        """Receive and store the image; what arrived of an upload that breaks off is kept."""
        first = await self._next()
        if first is None:
            raise MalformedRequestError("The stream is empty.", hint="Send a message with `upload` first.")
        upload, metadata = await run_sync(self._begin, first)
        app, tenant_id = self._app, self._caller.tenant_id
        left_bytes = upload.size_bytes - upload.offset_bytes
        with (
            app.upload_places.place(self._caller, self._pace, left_bytes) as place,
            contextlib.ExitStack() as stack,
        ):
            known = await run_sync(app.images.known, self._caller, upload.scene_id, upload.digest, metadata)
            if known is not None:
                return _response(known, created=False)
            # The thread enters it: its file is deleted also when the call is cancelled meanwhile.
            receiver = await to_its_end(run_sync(lambda: stack.enter_context(self._receiver(upload))))
            try:
                async with place.receiving():
                    await self._receive_all(upload, receiver)
                async with app.inspection_turns.turn(self._caller):
                    # An inspection cannot be interrupted, and has its turn until it ends.
                    image, created = await to_its_end(run_sync(self._store, upload, receiver, metadata))
            except (InvalidRequestError, OutOfSpaceError):  # not this image; or no room to keep it
                raise
            except BaseException:  # also that the client is gone
                await to_its_end(
                    run_sync(lambda: app.partial_uploads.keep(tenant_id, upload, receiver.part()))
                )
                raise
        if created:
            self._metrics.images.labels(image.verdict.value).inc()
        return _response(image, created=created)

    def _begin(self, content: bytes) -> tuple[NewUpload, ImageMetadata]:
        """Validate the first message and authorise the caller; return the upload and its metadata."""
        message = parsed(pb.UploadImageRequest, content)
        if message.WhichOneof("part") != "upload":
            raise InvalidRequestError(
                "The first message of an upload has no `upload`.",
                hint="Send `upload` first, then the bytes as `chunk`.",
            )
        self._name(message.upload)
        self._app.scenes.require(self._caller, Scope.UPLOAD, message.upload.scene_id)
        upload = pick(NewUpload, message.upload)
        if upload.offset_bytes > upload.size_bytes:
            raise InvalidRequestError(
                f"The offset lies outside of the {upload.size_bytes} bytes.",
                hint="Start at the first byte that has not arrived.",
            )
        return upload, read(ImageMetadata, message.upload.metadata)

    def _receiver(self, upload: NewUpload) -> Receiver:
        """The file that the bytes are written to, after those of the upload that is resumed."""
        partial, tenant_id = self._app.partial_uploads, self._caller.tenant_id
        name = partial.name(tenant_id, upload)
        if upload.offset_bytes == 0:
            return self._app.staging.receive(upload.size_bytes, name=name)
        return self._app.staging.receive(
            upload.size_bytes,
            lambda path: partial.take(tenant_id, upload, path),
            name,
            upload.offset_bytes,
        )

    async def _receive_all(self, upload: NewUpload, receiver: Receiver) -> None:
        while (content := await self._next()) is not None:
            await run_sync(self._write, upload, receiver, content)
        if receiver.size_bytes < upload.size_bytes:
            raise MalformedRequestError(
                f"The stream ended after {receiver.size_bytes} of {upload.size_bytes} bytes.",
                hint="Send the rest: GetUpload returns the offset to resume at.",
            )

    def _write(self, upload: NewUpload, receiver: Receiver, content: bytes) -> None:
        message = parsed(pb.UploadImageRequest, content)
        if message.WhichOneof("part") != "chunk":
            raise InvalidRequestError(
                "A message after the first has no `chunk`.", hint="Send only chunks after `upload`."
            )
        if receiver.size_bytes + len(message.chunk) > upload.size_bytes:
            raise InvalidRequestError(
                f"The stream has more than the {upload.size_bytes} bytes that size_bytes declares.",
                hint="Send the image's size as size_bytes.",
            )
        self._messages += 1
        self._received_bytes += len(message.chunk)
        small = self._received_bytes < self._messages * _SMALL_CHUNK_BYTES
        if small and self._messages > _FREE_CHUNKS:
            raise InvalidRequestError("The chunks are too small.", hint="Send chunks of 16 KB to 1 MB.")
        receiver.write(message.chunk)
        self._metrics.received_bytes.inc(len(message.chunk))

    def _store(self, upload: NewUpload, receiver: Receiver, metadata: ImageMetadata) -> tuple[Image, bool]:
        staged = receiver.finish()
        require_digest(staged.digest, upload.digest)
        return self._app.images.store(self._caller, upload.scene_id, staged, metadata)

    async def _next(self) -> bytes | None:
        return await self._pace.wait(self._receive, _size)


def _size(content: bytes | None) -> int:
    return 0 if content is None else len(content)


def _response(image: Image, *, created: bool) -> pb.UploadImageResponse:
    return pb.UploadImageResponse(created=created, image=write(image, pb.Image))
