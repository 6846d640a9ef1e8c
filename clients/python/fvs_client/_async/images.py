"""The images of a scene: upload, check, get, list, exclude, delete and download them."""

import hashlib
from collections.abc import AsyncIterator, Callable, Iterable
from os import PathLike
from pathlib import Path

from fvs_client import requests
from fvs_client._async import downloading, uploading
from fvs_client._async.session import AsyncSession
from fvs_client.downloads import DownloadProgress, target_path
from fvs_client.image_files import Paths
from fvs_client.models.display import Jpeg
from fvs_client.uploads import Describe, UploadProgress, UploadReport
from fvs_schema.images import DigestAnswer, Image, ImageMetadata
from fvs_schema.snapshots import Artifact


class AsyncSceneImages:
    """The images of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def upload(
        self,
        paths: Paths,
        *,
        parallel: int = 8,
        on_progress: Callable[[UploadProgress], object] | None = None,
        describe: Describe | None = None,
    ) -> UploadReport:
        """Upload images and videos, and folders with all that are in them, ``parallel`` of them at a time.

        Images that the scene has are not sent, so that repeating an interrupted upload resumes it. An image's
        mask is sent after it (see ``fvs_schema.masks.find_mask``), and ``VIDEO.SRT`` before its video. A job
        of the service takes the frames of a video. A file that fails is in the report and
        does not stop the others. ``describe`` returns metadata of a file (a position, a name).
        ``on_progress`` is called by one thread at a time: of ``Client`` by its upload threads, of
        ``AsyncClient`` by the event loop's.
        """
        return await uploading.upload(
            self._session,
            self._scene_id,
            paths,
            parallel=parallel,
            describe=describe,
            on_progress=on_progress,
        )

    async def put(self, content: bytes, metadata: ImageMetadata | None = None) -> Image:
        """Upload one image from memory."""
        digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
        request = requests.put_image(self._scene_id, digest, content, metadata)
        return await self._session.fetch(Image, request)

    async def set_mask(self, digest: str, mask: bytes) -> Image:
        """Give an image a mask, a PNG of its size in which black is left out; the next update uses it."""
        return await self._session.fetch(Image, requests.set_mask(self._scene_id, digest, mask))

    async def remove_mask(self, digest: str) -> Image:
        """Take the mask of an image away."""
        return await self._session.fetch(Image, requests.remove_mask(self._scene_id, digest))

    async def set_subtitles(self, digest: str, subtitles: bytes) -> None:
        """Send the subtitles (SRT) that a drone recorded with the video of this digest, before the video."""
        await self._session.content(requests.set_subtitles(self._scene_id, digest, subtitles))

    async def check(self, digests: Iterable[str]) -> DigestAnswer:
        """Check which of these digests (``sha256:…``) the scene has."""
        return await self._session.fetch(DigestAnswer, requests.check_images(self._scene_id, digests))

    async def get(self, digest: str) -> Image:
        """Get an image's record."""
        return await self._session.fetch(Image, requests.get_image(self._scene_id, digest))

    async def exclude(self, digest: str) -> Image:
        """Leave an image out of the next update's model; its bytes stay."""
        return await self._session.fetch(Image, requests.exclude_image(self._scene_id, digest))

    async def include(self, digest: str) -> Image:
        """Use an excluded or quarantined image again, in the next update."""
        return await self._session.fetch(Image, requests.include_image(self._scene_id, digest))

    async def delete(self, digest: str) -> None:
        """Delete an image with its bytes; the next update makes a model without it."""
        await self._session.content(requests.delete_image(self._scene_id, digest))

    async def download(
        self,
        image: Image,
        path: str | PathLike[str] = ".",
        *,
        on_progress: Callable[[DownloadProgress], object] | None = None,
    ) -> Path:
        """Write the original of ``image`` to ``path`` (or into that folder, under its name), verified.

        Returns where it is. An interrupted download resumes where it ended. Raises ``DamagedDownloadError``,
        and ``NotFoundError`` for an image that was not accepted, whose bytes are not kept.
        """
        artifact = Artifact(
            name=image.name,
            media_type="application/octet-stream",
            size_bytes=image.size_bytes,
            sha256=image.digest.removeprefix("sha256:"),
        )
        source = requests.original_of(self._scene_id, image.digest)
        target = target_path(path, image.name)
        return await downloading.download(self._session, source, artifact, target, on_progress)

    async def thumbnail(self, digest: str) -> Jpeg:
        """Get an accepted image with a long side of at most 320 px, upright; a notebook shows it.

        Raises ``NotFoundError`` for an image that was not accepted.
        """
        return Jpeg(await self._session.content(requests.get_thumbnail(self._scene_id, digest)))

    def list(self) -> AsyncIterator[Image]:
        """All images in order of arrival."""
        return self._session.items(Image, requests.images_of(self._scene_id))
