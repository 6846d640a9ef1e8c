"""The bytes of a resumable upload: appended while they arrive, stored as an image when all have arrived."""

import contextlib

from anyio.to_thread import run_sync
from fastapi import Request

from fvs_schema.images import Image
from fvs_service.application import Application
from fvs_service.errors import (
    ChecksumMismatchError,
    DigestMismatchError,
    OffsetMismatchError,
    PayloadTooLargeError,
)
from fvs_service.gateway.rest.bodies import blocks, declared_bytes
from fvs_service.images.rest_tus import Checksum
from fvs_service.images.resumable_uploads import (
    ResumableUpload,
    UploadWriter,
    beyond_end,
    unknown_upload,
)
from fvs_service.images.staging import require_digest
from fvs_service.images.upload_places import UploadPlace
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics
from fvs_service.uninterrupted import to_its_end


class Reception:
    """Operations of one caller's requests on an upload."""

    def __init__(
        self, app: Application, metrics: Metrics, caller: Principal, upload: ResumableUpload
    ) -> None:
        self._app, self._metrics, self._caller, self._upload = app, metrics, caller, upload

    async def offset(self) -> int:
        """The offset at which the upload continues; if all bytes have arrived, the image has been stored.

        Only then: a gateway that was killed between both must not tell the client that it is done.
        """
        arrived = await run_sync(self._arrived)
        if arrived is not None and arrived < self._upload.size_bytes:
            return arrived
        async with self._app.upload_locks.locked(self._upload.id):  # of who may be storing it
            return await self._stored()

    async def receive(self, request: Request, offset: int, checksum: Checksum | None) -> int:
        """Append the body, which begins at ``offset``; returns the offset at which the upload continues.

        Raises ``OffsetMismatchError``, ``ChecksumMismatchError``, ``PayloadTooLargeError``, and the errors of
        storing an image.
        """
        app, upload, declared = self._app, self._upload, declared_bytes(request)
        if declared is not None and offset + declared > upload.size_bytes:
            raise beyond_end(upload.size_bytes)
        with app.upload_places.place(self._caller, request.state.pace, declared) as place:
            async with app.upload_locks.locked(upload.id, place):
                arrived = await run_sync(self._arrived)
                if arrived is None:
                    raise unknown_upload()
                if arrived != offset:
                    raise OffsetMismatchError(
                        f"{arrived} bytes of the upload have arrived, not {offset}.",
                        hint="HEAD returns the offset at which it continues.",
                    )
                if arrived < upload.size_bytes:
                    arrived = await self._append(request, place, checksum)
                return arrived if arrived < upload.size_bytes else await self._stored()

    async def _append(self, request: Request, place: UploadPlace, checksum: Checksum | None) -> int:
        app, hashed = self._app, None if checksum is None else checksum.hash()
        with contextlib.ExitStack() as stack:
            # The thread enters them: they are left also when the request ends meanwhile.
            def opened() -> UploadWriter:
                writer = stack.enter_context(app.resumable_uploads.writer(self._upload, hashed))
                stack.callback(app.staging.expect(lambda: writer.awaited_bytes))
                return writer

            writer = await to_its_end(run_sync(opened))
            try:
                async with place.receiving(), contextlib.aclosing(blocks(request)) as body:
                    async for block in body:
                        await to_its_end(run_sync(writer.write, block))
                if hashed is not None and checksum is not None and hashed.digest() != checksum.expected:
                    raise ChecksumMismatchError(
                        f"The bytes do not have the {checksum.algorithm} of Upload-Checksum; none is kept.",
                        hint="Send them again.",
                    )
            except (ChecksumMismatchError, PayloadTooLargeError):
                await to_its_end(run_sync(writer.undo))
                raise
            return writer.size_bytes

    async def _stored(self) -> int:
        """Store the image of an upload whose bytes have all arrived; the offset, which is its size.

        Other requests of the upload wait meanwhile, and the inspection is not interrupted.
        """
        arrived = await run_sync(self._arrived)  # another request may have stored it, or found it damaged
        if arrived is None:
            raise unknown_upload()
        if arrived < self._upload.size_bytes:
            return arrived
        if await run_sync(self._known):
            await run_sync(self._app.resumable_uploads.discard_bytes, self._upload)
            return arrived
        async with self._app.inspection_turns.turn(self._caller):
            image, created = await to_its_end(run_sync(self._store))
        if created:
            self._metrics.images.labels(image.verdict.value).inc()
        return self._upload.size_bytes

    def _store(self) -> tuple[Image, bool]:
        app, upload = self._app, self._upload
        try:
            with app.resumable_uploads.staged(upload) as staged:
                require_digest(staged.digest, upload.digest)
                return app.images.store(self._caller, upload.scene_id, staged, upload.metadata)
        except DigestMismatchError:
            app.resumable_uploads.remove(upload)
            raise

    def _arrived(self) -> int | None:
        """Number of bytes that the service has, in whatever form; None for an upload that is gone."""
        if self._known():
            return self._upload.size_bytes
        return self._app.resumable_uploads.arrived_bytes(self._upload)

    def _known(self) -> bool:
        """Whether the scene has the image; raises the errors of an upload that it does not accept."""
        upload = self._upload
        found = self._app.images.known(self._caller, upload.scene_id, upload.digest, upload.metadata)
        return found is not None
