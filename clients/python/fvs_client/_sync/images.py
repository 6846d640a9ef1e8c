# Generated from _async/images.py by `make generate`. Do not edit.
"""The images of a scene: upload, check, get and list them."""

import hashlib
from collections.abc import Callable, Iterable, Iterator

from fvs_client import requests
from fvs_client._sync import uploading
from fvs_client._sync.session import Session
from fvs_client.image_files import Paths
from fvs_client.models.images import DigestAnswer, Image, ImageMetadata
from fvs_client.uploads import Describe, UploadProgress, UploadReport


class SceneImages:
    """The images of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def upload(
        self,
        paths: Paths,
        *,
        parallel: int = 8,
        on_progress: Callable[[UploadProgress], object] | None = None,
        describe: Describe | None = None,
    ) -> UploadReport:
        """Upload image files, and folders with all images in them, ``parallel`` of them at a time.

        Images that the scene has are not sent, so that repeating an interrupted upload resumes it. A file
        that fails is in the report and does not stop the others. ``describe`` returns what is known of a file
        (a position, a name). ``on_progress`` is called by one thread at a time: of ``Client`` by its upload
        threads, of ``AsyncClient`` by the event loop's.
        """
        return uploading.upload(
            self._session,
            self._scene_id,
            paths,
            parallel=parallel,
            describe=describe,
            on_progress=on_progress,
        )

    def put(self, content: bytes, metadata: ImageMetadata | None = None) -> Image:
        """Upload one image from memory."""
        digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
        request = requests.put_image(self._scene_id, digest, content, metadata)
        return self._session.fetch(Image, request)

    def check(self, digests: Iterable[str]) -> DigestAnswer:
        """Ask which of these digests (``sha256:…``) the scene has."""
        return self._session.fetch(DigestAnswer, requests.check_images(self._scene_id, digests))

    def get(self, digest: str) -> Image:
        """Get an image's record."""
        return self._session.fetch(Image, requests.get_image(self._scene_id, digest))

    def list(self) -> Iterator[Image]:
        """All images in order of arrival."""
        return self._session.items(Image, requests.images_of(self._scene_id))
