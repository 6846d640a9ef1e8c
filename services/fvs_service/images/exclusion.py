"""The operations that take images out of a scene's next model, and put them back.

*Excluded* images are left out on request, *quarantined* ones because they crash structure from motion; the
next update makes a model without them. Deleted images are gone, with their bytes.
"""

from collections.abc import Mapping

from sqlalchemy.orm import Session

from fvs_schema.events import EventKind
from fvs_schema.findings import Finding
from fvs_schema.images import Image, Registration, Verdict
from fvs_service.errors import ConflictError, NotFoundError
from fvs_service.events.repository import publish
from fvs_service.images import repository
from fvs_service.images.videos import remove_bytes
from fvs_service.jobs.service import Jobs
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.scenes.repository import scene_head_of, scene_of
from fvs_service.storage.blob_keys import image_key, mask_key, thumbnail_key
from fvs_service.storage.database import Database
from fvs_service.storage.removals import remove_later


class Exclusions:
    """Excludes, includes and deletes images; each call can be repeated."""

    def __init__(self, database: Database, jobs: Jobs) -> None:
        self._database = database
        self._jobs = jobs

    def exclude(self, principal: Principal, scene_id: str, digest: str) -> Image:
        """Leave an accepted image out of the next model; its bytes stay."""
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            image = accepted_image(session, principal, scene_id, digest)
            if image.registration is Registration.EXCLUDED:
                return image
            changed = repository.change_registration(session, image, Registration.EXCLUDED)
            _publish(session, changed, EventKind.IMAGE_EXCLUDED)
        return changed

    def include(self, principal: Principal, scene_id: str, digest: str) -> Image:
        """Use an excluded or quarantined image again: it is pending until the next update."""
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            image = accepted_image(session, principal, scene_id, digest)
            if not image.registration.left_out:
                return image
            changed = repository.change_registration(session, image, Registration.PENDING)
            _publish(session, changed, EventKind.IMAGE_INCLUDED)
            self._jobs.update_if_due(session, principal.tenant_id, scene_of(session, principal, scene_id))
        return changed

    def delete(self, principal: Principal, scene_id: str, digest: str) -> None:
        """Delete an image and its duplicates, which have no bytes of their own.

        Raises ``NotFoundError`` when the scene does not have it.
        """
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            scene_head_of(session, principal, scene_id)
            deleted = repository.delete_image(session, scene_id, digest)
            if not deleted:
                raise NotFoundError("The scene has no such image.")
            for image in deleted:
                if image.verdict is Verdict.VIDEO:
                    remove_bytes(session, image)
                for key in (image_key(scene_id, image.sha256), thumbnail_key(scene_id, image.sha256)):
                    remove_later(session, scene_id, key)
                if image.mask is not None:
                    mask = image.mask.removeprefix("sha256:")
                    remove_later(session, scene_id, mask_key(scene_id, image.sha256, mask))
                _publish(session, image, EventKind.IMAGE_DELETED)


def quarantine(session: Session, lease: Lease, reasons: Mapping[str, Finding]) -> None:
    """Quarantine the images of the leased scene with these digests; those that are left out already stay."""
    require_lease(session, lease)
    for digest, reason in reasons.items():
        image = repository.find_image(session, lease.scene_id, digest)
        if image is None or image.registration.left_out or image.verdict is not Verdict.ACCEPTED:
            continue
        changed = repository.change_registration(session, image, Registration.QUARANTINED, reason)
        _publish(session, changed, EventKind.IMAGE_QUARANTINED)


def accepted_image(session: Session, principal: Principal, scene_id: str, digest: str) -> Image:
    """An image of the scene; raises ``NotFoundError``, and ``ConflictError`` when it is not accepted."""
    scene_head_of(session, principal, scene_id)
    image = repository.find_image(session, scene_id, digest)
    if image is None:
        raise NotFoundError("The scene has no such image.")
    if image.verdict is Verdict.VIDEO:
        raise ConflictError(
            "The image is a video, which models do not use.", hint="The images from its frames are used."
        )
    if image.verdict is not Verdict.ACCEPTED:
        raise ConflictError(
            f"The image is not used in models: its verdict is {image.verdict.value}.", hint=image.hint
        )
    return image


def _publish(session: Session, image: Image, kind: EventKind) -> None:
    data = image.model_dump(
        mode="json", include={"digest", "name", "registration", "reason", "hint", "finding"}
    )
    publish(session, image.scene_id, kind, data, subject=image.digest)
