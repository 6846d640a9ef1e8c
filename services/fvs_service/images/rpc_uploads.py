"""Uploads over gRPC: a stream that begins with a description of the image, followed by its bytes."""

from collections.abc import AsyncGenerator, Awaitable, Callable

from anyio.to_thread import run_sync
from fvs.v1 import images_pb2 as pb
from google.protobuf.message import Message

from fvs_schema.base import Model
from fvs_schema.images import ImageMetadata
from fvs_schema.names import Digest
from fvs_schema.quantities import Count
from fvs_service.application import Application
from fvs_service.errors import InvalidRequestError, MalformedRequestError
from fvs_service.gateway.rpc.calls import parsed
from fvs_service.gateway.rpc.conversion import pick, read, write
from fvs_service.gateway.upload_pace import UploadPace
from fvs_service.images.reception import Reception
from fvs_service.images.uploads import Upload
from fvs_service.principal import Principal, Scope
from fvs_service.telemetry import Metrics

_SMALL_CHUNK_BYTES, _FREE_CHUNKS = 64, 256
"""A stream may have this many chunks of any size; beyond that, the mean size is checked, as over HTTP."""


class _Beginning(Model):
    """The image that a stream sends, and where in it the stream begins."""

    scene_id: str
    digest: Digest
    size_bytes: Count = 0
    offset_bytes: Count = 0


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

    async def run(self) -> pb.UploadImageResponse:
        """Receive and store the image; what arrived of an upload that breaks off is kept."""
        first = await self._next()
        if first is None:
            raise MalformedRequestError("The stream is empty.", hint="Send a message with `upload` first.")
        upload, offset = await run_sync(self._begin, first)
        left_bytes = upload.size_bytes - offset
        with self._app.upload_places.place(self._caller, self._pace, left_bytes) as place:
            reception = Reception(self._app, self._metrics, self._caller, upload)
            image, created = await reception.receive_rest(self._chunks(left_bytes), place, offset)
        return pb.UploadImageResponse(created=created, image=write(image, pb.Image))

    def _begin(self, content: bytes) -> tuple[Upload, int]:
        """Validate the first message and authorise the caller; return the upload and its offset."""
        message = parsed(pb.UploadImageRequest, content)
        if message.WhichOneof("part") != "upload":
            raise InvalidRequestError(
                "The first message of an upload has no `upload`.",
                hint="Send `upload` first, then the bytes as `chunk`.",
            )
        self._name(message.upload)
        self._app.scenes.require(self._caller, Scope.UPLOAD, message.upload.scene_id)
        given = pick(_Beginning, message.upload)
        if given.offset_bytes > given.size_bytes:
            raise InvalidRequestError(
                f"The offset lies outside of the {given.size_bytes} bytes.",
                hint="Start at the first byte that has not arrived.",
            )
        upload = Upload(
            tenant_id=self._caller.tenant_id,
            scene_id=given.scene_id,
            digest=given.digest,
            size_bytes=given.size_bytes,
            metadata=read(ImageMetadata, message.upload.metadata),
        )
        return upload, given.offset_bytes

    async def _chunks(self, left_bytes: int) -> AsyncGenerator[bytes, None]:
        """The bytes of the messages after the first."""
        messages = received_bytes = 0
        while (content := await self._next()) is not None:
            message = parsed(pb.UploadImageRequest, content)
            if message.WhichOneof("part") != "chunk":
                raise InvalidRequestError(
                    "A message after the first has no `chunk`.", hint="Send only chunks after `upload`."
                )
            chunk: bytes = message.chunk
            messages += 1
            received_bytes += len(chunk)
            if received_bytes > left_bytes:
                raise InvalidRequestError(
                    f"The stream has more than the {left_bytes} bytes that are left of size_bytes.",
                    hint="Send the image's size as size_bytes.",
                )
            if received_bytes < messages * _SMALL_CHUNK_BYTES and messages > _FREE_CHUNKS:
                raise InvalidRequestError("The chunks are too small.", hint="Send chunks of 16 KB to 1 MB.")
            yield chunk
            self._metrics.received_bytes.inc(len(chunk))

    async def _next(self) -> bytes | None:
        return await self._pace.wait(self._receive, _size)


def _size(content: bytes | None) -> int:
    return 0 if content is None else len(content)
