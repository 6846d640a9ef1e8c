"""The bytes of an upload: written while they arrive, over any transport, then stored as an image."""

import contextlib
from collections.abc import AsyncGenerator

from anyio.to_thread import run_sync

from fvs_schema.images import Image
from fvs_service.application import Application
from fvs_service.errors import (
    ChecksumMismatchError,
    DigestMismatchError,
    InvalidRequestError,
    MalformedRequestError,
    OffsetMismatchError,
    PayloadTooLargeError,
)
from fvs_service.images.rest_tus import Checksum
from fvs_service.images.upload_files import Writer, require_digest
from fvs_service.images.upload_places import UploadPlace
from fvs_service.images.uploads import Upload, unknown_upload
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics
from fvs_service.uninterrupted import to_its_end


class Reception:
    """Operations of one caller's requests on an upload."""

    def __init__(self, app: Application, metrics: Metrics, caller: Principal, upload: Upload) -> None:
        self._app, self._metrics, self._caller, self._upload = app, metrics, caller, upload
        self._digest: str | None = None
        """The digest of all bytes, when they have arrived in one request."""

    async def offset(self) -> int:
        """The offset at which the upload continues; if all bytes have arrived, the image has been stored.

        A gateway may have been killed between the last byte and the storing: so the image is stored first.
        """
        arrived = await run_sync(self._arrived)
        if arrived is not None and arrived < self._upload.size_bytes:
            return arrived
        async with self._app.upload_locks.locked(self._upload.id):  # another request may be storing it
            arrived = await run_sync(self._arrived)  # it may be stored by now, or found damaged
            if arrived is None:
                raise unknown_upload()
            if arrived == self._upload.size_bytes:
                await self._stored_or_known()
            return arrived

    async def receive_part(
        self, body: AsyncGenerator[bytes, None], place: UploadPlace, offset: int, checksum: Checksum | None
    ) -> int:
        """Append the body, which begins at ``offset``; returns the offset at which the upload continues.

        Raises ``LockedError``, ``OffsetMismatchError``, ``ChecksumMismatchError``, ``PayloadTooLargeError``,
        and the errors of storing an image.
        """
        async with self._app.upload_locks.locked(self._upload.id, place):
            arrived = await run_sync(self._arrived)
            if arrived is None:
                raise unknown_upload()
            if arrived != offset:
                raise OffsetMismatchError(
                    f"{arrived} bytes of the upload have arrived, not {offset}.",
                    hint="HEAD returns the offset at which it continues.",
                )
            if arrived < self._upload.size_bytes:
                arrived = await self._write(body, place, offset, checksum)
            if arrived == self._upload.size_bytes:
                await self._stored_or_known()
            return arrived

    async def receive_rest(
        self, body: AsyncGenerator[bytes, None], place: UploadPlace, offset: int = 0
    ) -> tuple[Image, bool]:
        """Write the body, all bytes from ``offset`` on, and return the image, and whether it is new.

        An upload that does not exist begins. While another request sends it, this one waits. Of an image that
        the scene has, the body is not read. Raises ``OffsetMismatchError`` unless the bytes before ``offset``
        have arrived, ``MalformedRequestError`` when the body ends early, and the errors of storing an image.
        """
        upload = self._upload
        async with self._app.upload_locks.locked(upload.id, place, waits=True):
            known = await run_sync(self._known_or_continued, offset)
            if known is not None:
                return known, False
            end = await self._write(body, place, offset, begin=True)
            if end < upload.size_bytes:
                raise MalformedRequestError(
                    f"The stream ended after {end} of {upload.size_bytes} bytes.",
                    hint="Send the rest: GetUpload returns the offset to resume at.",
                )
            return await self._stored()

    def _known_or_continued(self, offset: int) -> Image | None:
        """The image, if the scene has it; raises ``OffsetMismatchError`` for another offset than the next."""
        known = self._known()
        if known is not None:
            self._app.uploads.discard_bytes(self._upload)
        elif offset and offset != (arrived := self._app.uploads.arrived_bytes(self._upload) or 0):
            raise OffsetMismatchError(
                f"{arrived} bytes of the image have arrived, not {offset}.",
                hint="GetUpload returns the offset to resume at; if it finds none, send the whole image.",
            )
        return known

    async def _write(
        self,
        body: AsyncGenerator[bytes, None],
        place: UploadPlace,
        offset: int,
        checksum: Checksum | None = None,
        *,
        begin: bool = False,
    ) -> int:
        """Write the body; returns where it ends."""
        hashed = None if checksum is None else checksum.hash()
        with contextlib.ExitStack() as stack:
            # The thread enters the context, so that it is left even if the request ends meanwhile.
            def opened() -> Writer:
                return stack.enter_context(
                    self._app.uploads.writer(self._upload, offset, hashed, begin=begin)
                )

            writer = await to_its_end(run_sync(opened))
            try:
                async with place.receiving(), contextlib.aclosing(body):
                    async for block in body:
                        await to_its_end(run_sync(writer.write, block))
                if hashed is not None and checksum is not None and hashed.digest() != checksum.expected:
                    raise ChecksumMismatchError(
                        f"The bytes do not have the {checksum.algorithm} of Upload-Checksum; none is kept.",
                        hint="Send them again.",
                    )
            except (ChecksumMismatchError, PayloadTooLargeError, InvalidRequestError):
                await to_its_end(run_sync(writer.undo))
                raise
            self._digest = writer.digest
            return writer.offset

    async def _stored_or_known(self) -> None:
        """Store the image of a complete upload, unless the scene has the image already."""
        if await run_sync(self._known_or_continued, 0) is None:
            await self._stored()

    async def _stored(self) -> tuple[Image, bool]:
        """The image of an upload whose bytes have all arrived, and whether it is new.

        Other requests of the upload wait meanwhile, and the inspection is not interrupted.
        """
        async with self._app.inspection_turns.turn(self._caller):
            image, created = await to_its_end(run_sync(self._store))
        if created:
            self._metrics.images.labels(image.verdict.value).inc()
        return image, created

    def _store(self) -> tuple[Image, bool]:
        app, upload = self._app, self._upload
        try:
            with app.uploads.staged(upload, self._digest) as staged:
                require_digest(staged.digest, upload.digest)
                return app.images.store(self._caller, upload.scene_id, staged, upload.metadata)
        except DigestMismatchError:
            app.uploads.remove(upload)
            raise

    def _arrived(self) -> int | None:
        """Number of bytes that the service has, in whatever form; None for an upload that is gone."""
        if self._known() is not None:
            return self._upload.size_bytes
        return self._app.uploads.arrived_bytes(self._upload)

    def _known(self) -> Image | None:
        """The scene's image with the upload's digest, if any; raises the errors of a refused upload."""
        upload = self._upload
        return self._app.images.known(self._caller, upload.scene_id, upload.digest, upload.metadata)
