"""Images in the database."""

from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from fvs_engine.wording import notice
from fvs_schema.findings import Finding
from fvs_schema.images import Image, KnownImage, Registration, Verdict
from fvs_service.storage.tables import ImageRow, SceneRow, frames_not_taken

_HEX = len("sha256:")
_LEFT_OUT = [registration.value for registration in Registration if registration.left_out]
_QUARANTINE_HINT = "Replace it by another photograph; or include it, and the next update tries it again."
_VARIABLES = 500
"""Databases limit the values in one query."""


def add_image(session: Session, image: Image, pixels_sha256: str | None, thumbnail_bytes: int) -> None:
    """Add an image, whose thumbnail has so many bytes."""
    document = image.model_dump(mode="json", exclude={"registration"})
    session.add(
        ImageRow(
            scene_id=image.scene_id,
            sha256=image.digest[_HEX:],
            number=image.number,
            name=image.name,
            verdict=image.verdict.value,
            registration=image.registration.value,
            pixels_sha256=pixels_sha256,
            document={**document, "thumbnail_bytes": thumbnail_bytes},
            received_at=image.received_at,
        )
    )
    session.flush()


def find_image(session: Session, scene_id: str, digest: str) -> Image | None:
    """The image with this digest; None when the scene does not have it."""
    row = session.get(ImageRow, (scene_id, digest[_HEX:]))
    return None if row is None else _image(row)


def same_pixels(session: Session, scene_id: str, pixels_sha256: str | None) -> Image | None:
    """The accepted image with these pixels; None when there is none, or when they are unknown."""
    if pixels_sha256 is None:
        return None
    row = session.scalar(
        select(ImageRow).where(
            ImageRow.scene_id == scene_id,
            ImageRow.pixels_sha256 == pixels_sha256,
            ImageRow.verdict == Verdict.ACCEPTED.value,
        )
    )
    return None if row is None else _image(row)


def images_after(session: Session, scene_id: str, number: int, limit: int) -> tuple[Image, ...]:
    """Images of a scene that arrived after the one with ``number``."""
    rows = session.scalars(
        select(ImageRow)
        .where(ImageRow.scene_id == scene_id, ImageRow.number > number)
        .order_by(ImageRow.number)
        .limit(limit)
    )
    return tuple(map(_image, rows))


def usable_images(session: Session, scene_id: str) -> tuple[Image, ...]:
    """The images of a scene that updates use, in the order of arrival: accepted, and not left out."""
    rows = session.scalars(
        select(ImageRow)
        .where(
            ImageRow.scene_id == scene_id,
            ImageRow.verdict == Verdict.ACCEPTED.value,
            ImageRow.registration.not_in(_LEFT_OUT),
        )
        .order_by(ImageRow.number)
    )
    return tuple(map(_image, rows))


def known_images(session: Session, scene_id: str, digests: Collection[str]) -> dict[str, KnownImage]:
    """The images of a scene that have one of ``digests``, by digest."""
    found: dict[str, KnownImage] = {}
    wanted = [digest[_HEX:] for digest in digests]
    for start in range(0, len(wanted), _VARIABLES):
        rows = session.execute(
            select(
                ImageRow.sha256, ImageRow.verdict, ImageRow.name, ImageRow.registration, ImageRow.document
            ).where(ImageRow.scene_id == scene_id, ImageRow.sha256.in_(wanted[start : start + _VARIABLES]))
        )
        for sha256, verdict, name, registration, document in rows:
            digest, shown = f"sha256:{sha256}", _reason(name, registration, document)
            found[digest] = KnownImage(
                digest=digest,
                verdict=Verdict(verdict),
                reason=shown["reason"],
                hint=shown["hint"],
                mask=document["mask"],
            )
    return found


def in_order_of_capture(session: Session, scene_id: str) -> tuple[str, ...]:
    """The digests of accepted images in the order in which they were taken, or arrived.

    They were taken in a known order if all have a time.
    """
    rows = session.execute(
        select(ImageRow.sha256, ImageRow.document["captured_at"].as_string())
        .where(ImageRow.scene_id == scene_id, ImageRow.verdict == Verdict.ACCEPTED.value)
        .order_by(ImageRow.number)
    ).all()
    if all(captured_at is not None for _, captured_at in rows):
        rows = sorted(rows, key=lambda row: datetime.fromisoformat(row[1]))
    return tuple(f"sha256:{sha256}" for sha256, _ in rows)


def waiting_videos(session: Session, scene_id: str) -> tuple[Image, ...]:
    """The videos of a scene whose frames are still to be taken, in the order of arrival."""
    rows = session.scalars(
        select(ImageRow).where(ImageRow.scene_id == scene_id, frames_not_taken()).order_by(ImageRow.number)
    )
    return tuple(map(_image, rows))


def frames_of(session: Session, scene_id: str, video: str) -> dict[str, str]:
    """The images that were made from a video: name → digest."""
    rows = session.execute(
        select(ImageRow.name, ImageRow.sha256).where(
            ImageRow.scene_id == scene_id, ImageRow.document["video"].as_string() == video
        )
    )
    return {name: f"sha256:{sha256}" for name, sha256 in rows}


def change_video(session: Session, video: Image, verdict: Verdict, **values: object) -> Image | None:
    """Write what became of a video; returns the changed one, None when it was deleted."""
    row = session.get(ImageRow, (video.scene_id, video.sha256))
    if row is None:
        return None
    row.verdict = verdict.value
    row.document = {**row.document, "verdict": verdict.value, **values}
    session.flush()
    return _image(row)


def next_number(session: Session, scene_id: str) -> int:
    """Take the next number of an image; none is given twice, even when its image is deleted."""
    number = session.scalar(
        update(SceneRow)
        .where(SceneRow.id == scene_id)
        .values(last_image_number=SceneRow.last_image_number + 1)
        .returning(SceneRow.last_image_number)
    )
    assert number is not None
    return int(number)


def change_registration(
    session: Session, image: Image, registration: Registration, why: Finding | None = None
) -> Image:
    """Write an image's registration and the reason; returns the changed image."""
    row = session.get_one(ImageRow, (image.scene_id, image.sha256))
    row.registration = registration.value
    row.document = _with_finding(row, why)
    session.flush()
    return _image(row)


def change_mask(session: Session, image: Image, mask: str | None) -> Image:
    """Write the digest of an image's mask; returns the changed image, which has a new number and no pose.

    An excluded image stays so.
    """
    row = session.get_one(ImageRow, (image.scene_id, image.sha256))
    row.number = next_number(session, image.scene_id)
    if row.registration != Registration.EXCLUDED.value:
        row.registration = Registration.PENDING.value
    row.document = {**_with_finding(row, None), "number": row.number, "mask": mask}
    session.flush()
    return _image(row)


def delete_image(session: Session, scene_id: str, digest: str) -> tuple[Image, ...]:
    """Delete an image and its duplicates; returns them, none when the scene does not have it."""
    row = session.get(ImageRow, (scene_id, digest[_HEX:]))
    if row is None:
        return ()
    rows = [row]
    if row.verdict == Verdict.ACCEPTED.value and row.pixels_sha256 is not None:
        rows += session.scalars(
            select(ImageRow).where(
                ImageRow.scene_id == scene_id,
                ImageRow.pixels_sha256 == row.pixels_sha256,
                ImageRow.verdict == Verdict.DUPLICATE.value,
            )
        )
    for found in rows:
        session.delete(found)
    session.flush()
    return tuple(map(_image, rows))


def register(
    session: Session,
    scene_id: str,
    registered: Iterable[str],
    unregistered: Mapping[str, Finding | None],
    last_number: int | None = None,
) -> None:
    """Record which accepted images, given by digest, have a pose in the current model.

    ``unregistered``: those without one → the reason, None where it is not known. Those that are left out stay
    so: they were taken out while the model was made. So do those after ``last_number``, which were sent
    again, or got a mask, in the meantime.
    """
    registered = list(registered)
    posed = {digest[_HEX:] for digest in registered}
    for row in _unregistered(session, scene_id):
        if row.sha256 in posed:
            row.document = _with_finding(row, None)
    session.flush()
    for registration, digests in (
        (Registration.REGISTERED, registered),
        (Registration.UNREGISTERED, list(unregistered)),
    ):
        for start in range(0, len(digests), _VARIABLES):
            session.execute(
                update(ImageRow)
                .where(
                    ImageRow.scene_id == scene_id,
                    ImageRow.verdict == Verdict.ACCEPTED.value,
                    ImageRow.registration.not_in(_LEFT_OUT),
                    *(() if last_number is None else (ImageRow.number <= last_number,)),
                    ImageRow.sha256.in_(digest[_HEX:] for digest in digests[start : start + _VARIABLES]),
                )
                .values(registration=registration.value)
            )
    reasons = {digest[_HEX:]: reason for digest, reason in unregistered.items()}
    for row in _unregistered(session, scene_id):
        if row.sha256 in reasons:
            row.document = _with_finding(row, reasons[row.sha256])
    session.flush()


def _unregistered(session: Session, scene_id: str) -> list[ImageRow]:
    unregistered = ImageRow.registration == Registration.UNREGISTERED.value
    return list(session.scalars(select(ImageRow).where(ImageRow.scene_id == scene_id, unregistered)))


def _with_finding(row: ImageRow, finding: Finding | None) -> dict[str, Any]:
    return {**row.document, "finding": None if finding is None else finding.model_dump(mode="json")}


def _image(row: ImageRow) -> Image:
    shown = _reason(row.name, row.registration, row.document)
    return Image.model_validate({**row.document, **shown, "registration": row.registration})


def _reason(name: str, registration: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """What an image shows of why it is not accepted or has no pose: the sentences, and the code."""
    if registration == Registration.EXCLUDED.value:
        return {"reason": "It was excluded.", "hint": "Include it again to use it.", "finding": None}
    if document["finding"] is None:
        return {key: document[key] for key in ("reason", "hint", "finding")}
    found = Finding.model_validate(document["finding"]).model_copy(update={"images": (name,)})
    shown = notice(found)
    hint = _QUARANTINE_HINT if registration == Registration.QUARANTINED.value else shown.hint
    return {"reason": shown.message, "hint": hint, "finding": shown.code}
