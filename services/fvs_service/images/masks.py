"""The masks of images: what of a photograph counts.

An image that gets another mask is as one that was deleted and sent again: it has a new number, and the next
update takes it out of the model and registers it anew.
"""

import tempfile
from pathlib import Path

from sqlalchemy.orm import Session

from fvs_schema.error_codes import FieldError
from fvs_schema.images import Image
from fvs_schema.masks import MASKS
from fvs_service.errors import InvalidRequestError
from fvs_service.images import repository
from fvs_service.images.exclusion import accepted_image
from fvs_service.images.files import blob_key, file_name
from fvs_service.images.inspector import Inspector
from fvs_service.images.upload_files import StagedFile
from fvs_service.jobs.service import Jobs
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.repository import scene_of
from fvs_service.storage.blob_keys import mask_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.removals import ABANDONED_AFTER, keep, remove_later


class Masks:
    """Sets and removes the masks of images; each call can be repeated."""

    def __init__(self, database: Database, blobs: Blobs, inspector: Inspector, jobs: Jobs) -> None:
        self._database = database
        self._blobs = blobs
        self._inspector = inspector
        self._jobs = jobs

    def set(self, principal: Principal, scene_id: str, digest: str, mask: StagedFile) -> Image:
        """Give an accepted image the mask, which is a PNG; no effect when it has the same one.

        Raises ``NotFoundError`` for an unknown image, ``InvalidRequestError`` when the mask cannot be used.
        """
        principal.require(Scope.UPLOAD, scene_id)
        with self._database.reading() as session:
            image = accepted_image(session, principal, scene_id, digest)
        if image.mask == mask.digest:
            return image
        self._require_usable(image, mask.path)
        key = mask_key(scene_id, image.sha256, mask.digest.removeprefix("sha256:"))
        with self._database.writing(scene_id, durable=False) as session:
            scene_of(session, principal, scene_id)
            remove_later(session, scene_id, key, after=ABANDONED_AFTER)
        self._blobs.adopt(mask.path, key)
        with self._database.writing(scene_id) as session:
            changed = self._change(session, principal, scene_id, digest, mask.digest)
            keep(session, [key])
        return changed

    def remove(self, principal: Principal, scene_id: str, digest: str) -> Image:
        """Take the mask of an accepted image away: all of it counts."""
        principal.require(Scope.UPLOAD, scene_id)
        with self._database.writing(scene_id) as session:
            return self._change(session, principal, scene_id, digest, None)

    def _change(
        self, session: Session, principal: Principal, scene_id: str, digest: str, mask: str | None
    ) -> Image:
        image = accepted_image(session, principal, scene_id, digest)
        if image.mask == mask:
            return image
        if image.mask is not None:
            old = image.mask.removeprefix("sha256:")
            remove_later(session, scene_id, mask_key(scene_id, image.sha256, old))
        changed = repository.change_mask(session, image, mask)
        self._jobs.update_if_due(session, principal.tenant_id, scene_of(session, principal, scene_id))
        return changed

    def _require_usable(self, image: Image, mask: Path) -> None:
        """Raise unless the engine can use the mask for the image."""
        name = file_name(image)
        with tempfile.TemporaryDirectory(dir=mask.parent) as scratch:
            folder = Path(scratch)
            self._blobs.export(blob_key(image.scene_id, image.digest), folder / name)
            (folder / MASKS).mkdir()
            (folder / MASKS / f"{name}.png").hardlink_to(mask)
            problem = self._inspector.mask_problem(folder, name)
        if problem is not None:
            reason = problem.reason.replace(f" {MASKS}/{name}.png", "").replace("its mask", "it")
            raise InvalidRequestError(
                f"The mask of {image.name} cannot be used: {reason}",
                hint=problem.hint,
                errors=[FieldError("mask", reason)],
            )
