"""Videos: what the service keeps of one until a job has made images from its frames.

A video arrives as images do, and has its row among theirs, with the verdict ``video``. Its bytes, and those
of its subtitles, are removed once ``frames`` of the row tells how many images were made from it.
"""

from importlib.util import find_spec

from sqlalchemy.orm import Session

from fvs_schema.error_codes import FieldError
from fvs_schema.images import Image, ImageMetadata
from fvs_schema.videos import is_video
from fvs_service.errors import ConflictError, InvalidRequestError, UnsupportedMediaTypeError
from fvs_service.images import repository
from fvs_service.images.upload_files import StagedFile
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.repository import scene_of
from fvs_service.storage.blob_keys import subtitles_key, video_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.removals import SUBTITLES_KEPT, remove_later

EVERY_S = 1.0
"""Spacing of the frames where none is given."""


class Videos:
    """Receives the subtitles of videos."""

    def __init__(self, database: Database, blobs: Blobs) -> None:
        self._database = database
        self._blobs = blobs

    def set_subtitles(self, principal: Principal, scene_id: str, digest: str, file: StagedFile) -> None:
        """Keep the subtitles of a video that is sent next; others of it are replaced.

        Raises ``ConflictError`` when the scene has the video.
        """
        principal.require(Scope.UPLOAD, scene_id)
        key = subtitles_key(scene_id, digest.removeprefix("sha256:"))
        with self._database.writing(scene_id) as session:
            scene_of(session, principal, scene_id)
            found = repository.find_image(session, scene_id, digest)
            if found is not None and not is_video(found.name):
                raise ConflictError(
                    f"{found.name} is no video, and has no subtitles.", hint="Give the digest of a video."
                )
            if found is not None:
                raise ConflictError(
                    "The scene has the video already, and subtitles are read with its frames.",
                    hint="Delete the video and its frames, then send the subtitles before the video.",
                )
            remove_later(session, scene_id, key, after=SUBTITLES_KEPT)
        self._blobs.adopt(file.path, key)


def require_kind(metadata: ImageMetadata) -> None:
    """Raise unless the service takes a file with this name, and the metadata are of its kind.

    Raises ``UnsupportedMediaTypeError`` for a video where PyAV is missing, else ``InvalidRequestError``.
    """
    if not is_video(metadata.name or ""):
        if metadata.every_s is not None:
            raise InvalidRequestError(
                "Only a video has a spacing of frames.",
                hint="Give the name of the file with its end: .mp4, .mov, .mkv …",
                errors=[FieldError("every_s", "the name is not that of a video")],
            )
        return
    if find_spec("av") is None:
        raise UnsupportedMediaTypeError(
            "This service takes no videos: PyAV is not installed.",
            hint="Install the service with the extra `video`. Or send frames: fvs frames VIDEO.",
        )
    given = metadata.model_dump(exclude={"name", "every_s"}, exclude_none=True)
    if given:
        raise InvalidRequestError(
            "The frames of a video have the times and positions that were recorded with it.",
            hint="Give only name and every_s, and send the video's subtitles before it.",
            errors=[FieldError(name, "a video has none") for name in given],
        )


def remove_bytes(session: Session, video: Image) -> None:
    """Remove what is kept of a video, in the transaction after which it is not waiting for its frames."""
    for key in (video_key(video.scene_id, video.sha256), subtitles_key(video.scene_id, video.sha256)):
        remove_later(session, video.scene_id, key)
