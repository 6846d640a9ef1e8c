"""Upload image files: only those that the scene does not have, several at a time, each with its verdict.

Uploaded images stay in the scene, so an interrupted upload resumes when it is repeated.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fvs_client import requests
from fvs_client._async.concurrency import map_concurrently, run_blocking
from fvs_client._async.session import AsyncSession
from fvs_client.answers import parse
from fvs_client.errors import (
    ConflictError,
    ForbiddenError,
    FvsError,
    NotFoundError,
    UnauthenticatedError,
    UnreadableFormatError,
    UnusedMaskError,
)
from fvs_client.image_files import ImageFile, Paths, find_image_files
from fvs_client.request import FileBody
from fvs_client.uploads import (
    Describe,
    HashedFile,
    Outcome,
    UploadCounter,
    UploadedFile,
    UploadProgress,
    UploadReport,
    digest_of,
    hash_file,
    size_of,
    total_size,
)
from fvs_schema.images import DigestAnswer, Image, ImageMetadata

_BATCH = 256
"""Files that are hashed, checked and sent before the next ones are read."""
_MOST_SINGLE_VERDICTS = 8
"""Verdicts of more images that the scene had already are read from its list."""


async def upload(
    session: AsyncSession,
    scene_id: str,
    paths: Paths,
    *,
    parallel: int,
    describe: Describe | None,
    on_progress: Callable[[UploadProgress], object] | None,
) -> UploadReport:
    """Upload the files that the scene does not have.

    A file that cannot be read or is refused is in the report and does not stop the others. Errors that would
    repeat with every file are raised: no connection for the digests, an invalid API key, an unknown scene.
    """
    files = await run_blocking(find_image_files, paths)
    counter = UploadCounter(len(files), await run_blocking(total_size, files), on_progress)
    uploader = _Uploader(session, scene_id, parallel, describe, counter)
    for start in range(0, len(files), _BATCH):
        await uploader.send_batch(files[start : start + _BATCH])
    return await uploader.report(files)


class _Uploader:
    """Uploads files in batches, and keeps the outcome of each."""

    def __init__(
        self,
        session: AsyncSession,
        scene_id: str,
        parallel: int,
        describe: Describe | None,
        counter: UploadCounter,
    ) -> None:
        self._session, self._scene_id, self._parallel = session, scene_id, parallel
        self._describe = describe
        self._counter = counter
        self._done: dict[Path, UploadedFile] = {}
        self._masks: dict[str, str | None] = {}
        """The masks of images that the scene had already, by digest of the image."""

    async def send_batch(self, files: Sequence[ImageFile]) -> None:
        """Hash the files, check which of them the scene has, and send the others."""
        for file in files:
            if not file.sent:
                self._finish(_left_out(file), size_of(file.path))
        files = [file for file in files if file.sent]
        read = await map_concurrently(self._hash, files, self._parallel)
        to_send: dict[str, HashedFile] = {}
        known: list[HashedFile] = []
        for file, found in zip(files, read, strict=True):
            if isinstance(found, OSError):
                self._finish(UploadedFile(file.path, Outcome.FAILED, error=found))
            elif to_send.setdefault(found.digest, found) is not found:
                known.append(found)
        if to_send:
            check = requests.check_images(self._scene_id, to_send)
            answer = await self._session.fetch(DigestAnswer, check)
            known += [to_send.pop(digest) for digest in answer.known if digest in to_send]
            self._masks.update((image.digest, image.mask) for image in answer.images)
        sent = await map_concurrently(self._send, to_send.values(), self._parallel)
        failed = {file.digest: file for file in sent if file.outcome is Outcome.FAILED}
        for item, there in zip(
            known, await map_concurrently(self._known, known, self._parallel), strict=True
        ):
            twin = failed.get(item.digest)  # the same content under another name
            self._finish(there if twin is None else replace(twin, path=item.path), item.size_bytes)

    async def report(self, files: Sequence[ImageFile]) -> UploadReport:
        """The outcomes of ``files``, with the verdicts of images that the scene had already."""
        verdicts = await self._verdicts(self._done.values())
        outcomes = (self._done[file.path] for file in files)
        return UploadReport(
            tuple(replace(file, image=file.image or verdicts.get(file.digest or "")) for file in outcomes),
            self._counter.progress.bytes_sent,
        )

    async def _hash(self, file: ImageFile) -> HashedFile | OSError:
        return await run_blocking(hash_file, file)

    async def _send(self, item: HashedFile) -> UploadedFile:
        known = None if self._describe is None else self._describe(item.path)
        name = (known.name if known else None) or item.file.name
        metadata = (known or ImageMetadata()).model_copy(update={"name": name})
        body = FileBody(item.path, item.size_bytes, self._counter.sent)
        request = requests.put_image(self._scene_id, item.digest, body, metadata)
        try:
            await self._send_subtitles(item)
            content = await self._session.content(request)
        except (UnauthenticatedError, ForbiddenError, NotFoundError):
            raise
        except (FvsError, OSError) as error:
            return self._finish(UploadedFile(item.path, Outcome.FAILED, item.digest, error=error))
        sent = UploadedFile(item.path, Outcome.SENT, item.digest, parse(Image, content))
        return self._finish(await self._masked(item, sent) if sent.usable else sent)

    async def _send_subtitles(self, item: HashedFile) -> None:
        """Send what lies beside a video, and belongs to it."""
        if item.file.subtitles is not None:
            content = await run_blocking(item.file.subtitles.read_bytes)
            await self._session.content(requests.set_subtitles(self._scene_id, item.digest, content))

    async def _known(self, item: HashedFile) -> UploadedFile:
        return await self._masked(item, UploadedFile(item.path, Outcome.ALREADY_THERE, item.digest))

    async def _masked(self, item: HashedFile, there: UploadedFile) -> UploadedFile:
        """Send the mask of an image that the scene has, unless it has that too; the file afterwards."""
        if item.file.mask is None:
            return there
        try:
            mask = await run_blocking(item.file.mask.read_bytes)
            if self._masks.get(item.digest) == digest_of(mask):
                return there
            request = requests.set_mask(self._scene_id, item.digest, mask)
            return replace(there, image=await self._session.fetch(Image, request))
        except (UnauthenticatedError, ForbiddenError):
            raise
        except ConflictError:  # the image is not used, as its verdict says
            return there
        except (FvsError, OSError) as error:
            return replace(there, mask_error=error)

    def _finish(self, file: UploadedFile, unsent_bytes: int = 0) -> UploadedFile:
        self._done[file.path] = file
        self._counter.finished(file, unsent_bytes)
        return file

    async def _verdicts(self, files: Iterable[UploadedFile]) -> Mapping[str, Image]:
        """Images that the scene had already, by digest; none when the API key may not read images."""
        wanted = {file.digest for file in files if file.outcome is Outcome.ALREADY_THERE and file.digest}
        try:
            if len(wanted) <= _MOST_SINGLE_VERDICTS:
                images = await map_concurrently(self._get, sorted(wanted), self._parallel)
            else:
                listed = self._session.items(Image, requests.images_of(self._scene_id), {"limit": 1000})
                images = [image async for image in listed]
        except ForbiddenError:
            return {}
        return {image.digest: image for image in images if image.digest in wanted}

    async def _get(self, digest: str) -> Image:
        return await self._session.fetch(Image, requests.get_image(self._scene_id, digest))


def _left_out(file: ImageFile) -> UploadedFile:
    """The outcome of a file that is not sent."""
    error: FvsError = UnreadableFormatError(
        f"The service does not read {file.path.suffix[1:].upper()} files.", hint="Export it as JPEG or PNG."
    )
    if file.is_unused_mask:
        error = UnusedMaskError(
            "It is in a folder of masks, and the mask of no image.",
            hint="The mask of a.jpg is masks/a.png or masks/a.jpg.png. Move images to another folder.",
        )
    return UploadedFile(file.path, Outcome.FAILED, error=error)
