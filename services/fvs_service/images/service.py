"""The operations on images.

An upload arrives first (``uploads``): all of its bytes are on disk, and their digest is known. ``store``
then inspects them and commits the image, the bytes before the row: a crash in between loses no image that was
acknowledged, and an image that is sent again is stored once. Bytes whose row never came are removed later.
"""

from collections.abc import Iterator, Sequence

from sqlalchemy.orm import Session

from fvs_schema.base import Page
from fvs_schema.error_codes import FieldError
from fvs_schema.events import EventKind
from fvs_schema.images import (
    DigestAnswer,
    DigestCheck,
    Image,
    ImageList,
    ImageMetadata,
    ImageWarning,
    Prior,
    PriorSource,
    Registration,
    Verdict,
)
from fvs_schema.scenes import AltitudeDatum, AutomaticWorld, LocalWorld, Origin, Scene
from fvs_schema.service import Limits
from fvs_schema.videos import is_video
from fvs_service.errors import ConflictError, InvalidRequestError, NotFoundError, UnavailableError
from fvs_service.events.repository import publish
from fvs_service.images import repository
from fvs_service.images.files import blob_key
from fvs_service.images.inspection import Inspection
from fvs_service.images.inspector import Inspector
from fvs_service.images.upload_files import StagedFile
from fvs_service.images.videos import EVERY_S, require_kind
from fvs_service.jobs.service import Jobs
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.repository import scene_of, set_origin
from fvs_service.storage.blob_keys import image_key, subtitles_key, thumbnail_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.pages import Cursors, Place, cut
from fvs_service.storage.removals import ABANDONED_AFTER, has_row, keep, remove_later

_POSITION = ("latitude_deg", "longitude_deg", "altitude_m", "altitude_datum", "x_m", "y_m", "z_m")


class Images:
    """Checks, stores and returns images."""

    def __init__(
        self, database: Database, blobs: Blobs, inspector: Inspector, jobs: Jobs, limits: Limits
    ) -> None:
        self._database = database
        self._blobs = blobs
        self._inspector = inspector
        self._jobs = jobs
        self._limits = limits

    def check(self, principal: Principal, scene_id: str, request: DigestCheck) -> DigestAnswer:
        """Which of these digests the scene has, and with which verdicts."""
        principal.require(Scope.UPLOAD, scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            images = repository.known_images(session, scene_id, request.digests)
        known = tuple(digest for digest in request.digests if digest in images)
        return DigestAnswer(
            known=known,
            missing=tuple(digest for digest in request.digests if digest not in images),
            images=tuple(images[digest] for digest in known),
        )

    def require_open(self, principal: Principal, scene_id: str) -> None:
        """Raise unless the principal may send images to the scene and the scene is not full."""
        principal.require(Scope.UPLOAD, scene_id)
        with self._database.reading() as session:
            self._require_room(scene_of(session, principal, scene_id))

    def known(
        self, principal: Principal, scene_id: str, digest: str, metadata: ImageMetadata
    ) -> Image | None:
        """The image with this digest; None when the scene lacks it and ``metadata`` are valid."""
        principal.require(Scope.UPLOAD, scene_id)
        with self._database.reading() as session:
            scene = scene_of(session, principal, scene_id)
            found = repository.find_image(session, scene_id, digest)
        if found is None:
            self._require_room(scene)
            _require_frame(scene, metadata)
            require_kind(metadata)
        return found

    def store(
        self,
        principal: Principal,
        scene_id: str,
        staged: StagedFile,
        metadata: ImageMetadata,
        video: str | None = None,
    ) -> tuple[Image, bool]:
        """Inspect and store a staged file; returns the image, and whether it is new to the scene.

        ``video``: the digest of the video of which it is a frame. A job takes the frames of a new video.
        """
        found = self.known(principal, scene_id, staged.digest, metadata)
        if found is not None:
            return found, False
        inspection = self._inspected(staged, metadata)
        kept = inspection.verdict in (Verdict.ACCEPTED, Verdict.VIDEO)
        key = blob_key(scene_id, staged.digest, inspection.verdict)
        thumbnail, keys = inspection.thumbnail, [key]
        if thumbnail is not None:
            keys.append(thumbnail_key(scene_id, staged.digest.removeprefix("sha256:")))
        if kept and not self._has_twin(scene_id, inspection):
            with self._database.writing(scene_id, durable=False) as session:
                scene_of(session, principal, scene_id)  # the inspection may have outlasted it
                for each in keys:
                    remove_later(session, scene_id, each, after=ABANDONED_AFTER)
            self._blobs.adopt(staged.path, key)
            if thumbnail is not None:
                self._blobs.put(thumbnail, keys[-1])
        with self._database.writing(scene_id) as session:
            scene = scene_of(session, principal, scene_id)
            found = repository.find_image(session, scene_id, staged.digest)
            if found is not None:  # the same bytes, sent twice at once
                if has_row(session, key):
                    keep(session, keys)
                return found, False
            _require_frame(scene, metadata)
            twin = repository.same_pixels(session, scene_id, inspection.pixels_sha256)
            if twin is None and kept:
                self._require_stored(session, keys)
            number = repository.next_number(session, scene_id)
            image = _image(scene, staged, metadata, inspection, twin, number)
            image = image.model_copy(update={"video": video})
            repository.add_image(session, image, inspection.pixels_sha256, len(thumbnail or b""))
            self._set_origin(session, scene, image)
            data = image.model_dump(mode="json", exclude={"scene_id"})
            publish(session, scene_id, EventKind.IMAGE_RECEIVED, data, subject=image.digest)
            session.flush()
            if image.verdict is Verdict.VIDEO:
                keep(session, [subtitles_key(scene_id, image.sha256)])
                self._jobs.take_frames(session, principal.tenant_id, scene)
            else:
                self._jobs.update_if_due(session, principal.tenant_id, scene_of(session, principal, scene_id))
        return image, True

    def original(self, principal: Principal, scene_id: str, digest: str) -> Image:
        """An image whose bytes are kept; raises ``NotFoundError``."""
        image = self.get(principal, scene_id, digest)
        if image.verdict is not Verdict.ACCEPTED:
            raise NotFoundError(
                f"The bytes of the image are not kept: its verdict is {image.verdict.value}.",
                hint="Only accepted images can be downloaded."
                if image.duplicate_of is None
                else f"Download {image.duplicate_of}, which has the same pixels.",
            )
        return image

    def content(self, image: Image, start: int, stop: int) -> Iterator[bytes]:
        """The bytes of an accepted image, as they were sent."""
        return self._blobs.chunks(image_key(image.scene_id, image.sha256), start, stop)

    def thumbnail(self, image: Image) -> bytes:
        """A small JPEG of an accepted image, upright."""
        return self._blobs.read(thumbnail_key(image.scene_id, image.sha256))

    def get(self, principal: Principal, scene_id: str, digest: str) -> Image:
        """One image; raises ``NotFoundError``."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            found = repository.find_image(session, scene_id, digest)
        if found is None:
            raise NotFoundError("The scene has no such image.")
        return found

    def of_scene(self, principal: Principal, scene_id: str, page: Page) -> ImageList:
        """The images of a scene in the order of arrival; refuses a cursor of another list."""
        principal.require(Scope.READ, scene_id)
        cursors = Cursors("images", scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            last = cursors.read(page.after) or Place(0)
            images = repository.images_after(session, scene_id, last.number, page.limit + 1)
        items, following = cut(images, page.limit, lambda image: cursors.write(Place(image.number)))
        return ImageList(items=tuple(items), next=following)

    def _require_room(self, scene: Scene) -> None:
        if scene.image_counts.received >= self._limits.images_per_scene:
            raise ConflictError(
                f"The scene has {self._limits.images_per_scene} images; no more are allowed.",
                hint="Create another scene.",
            )

    def _inspected(self, staged: StagedFile, metadata: ImageMetadata) -> Inspection:
        if is_video(metadata.name or ""):
            return self._inspector.inspect_video(staged.path, self._limits.video_s)
        return self._inspector.inspect(staged.path)

    def _has_twin(self, scene_id: str, inspection: Inspection) -> bool:
        with self._database.reading() as session:
            return repository.same_pixels(session, scene_id, inspection.pixels_sha256) is not None

    def _require_stored(self, session: Session, keys: Sequence[str]) -> None:
        """Raise when a deletion of the image has just removed the bytes that were stored for its row."""
        if not all(map(self._blobs.exists, keys)):
            raise UnavailableError(
                "The image was deleted while it was sent.", hint="Send it again.", retry_after_s=1
            )
        keep(session, keys)

    def _set_origin(self, session: Session, scene: Scene, image: Image) -> None:
        prior = image.prior
        wanted = isinstance(scene.world, AutomaticWorld) and scene.origin is None
        if not wanted or image.verdict is not Verdict.ACCEPTED or prior is None:
            return
        if prior.latitude_deg is None or prior.longitude_deg is None or prior.altitude_m is None:
            return
        set_origin(
            session,
            scene.id,
            Origin(
                latitude_deg=prior.latitude_deg,
                longitude_deg=prior.longitude_deg,
                altitude_m=prior.altitude_m,
                altitude_datum=prior.altitude_datum or AltitudeDatum.SEA_LEVEL,
            ),
        )


def _require_frame(scene: Scene, metadata: ImageMetadata) -> None:
    if metadata.latitude_deg is not None and isinstance(scene.world, LocalWorld):
        raise InvalidRequestError(
            "The scene's world is local, so geodetic positions have no meaning in it.",
            hint="Give x_m, y_m and z_m.",
            errors=[FieldError("latitude_deg", "the scene's world is local")],
        )
    if metadata.x_m is not None and not isinstance(scene.world, LocalWorld):
        raise InvalidRequestError(
            "Only scenes with a local world accept x_m, y_m and z_m.",
            hint='Create the scene with {"world": {"kind": "local"}}, or give a latitude and a longitude.',
            errors=[FieldError("x_m", "the scene's world is not local")],
        )
    prior = metadata.prior()
    if prior is not None and not _same_datum(prior, scene):
        assert scene.origin is not None
        assert prior.altitude_datum is not None
        datum = scene.origin.altitude_datum
        raise InvalidRequestError(
            f"Altitudes of the scene are above {datum.in_words}, not {prior.altitude_datum.in_words}.",
            hint=f"Convert the altitude and send altitude_datum={datum.value}; or omit the position.",
            errors=[FieldError("altitude_datum", f"altitudes of the scene are above {datum.in_words}")],
        )


def _same_datum(prior: Prior, scene: Scene) -> bool:
    """Whether a prior's altitude has the datum of the scene's altitudes."""
    if prior.altitude_datum is None or scene.origin is None:
        return True
    return prior.altitude_datum is scene.origin.altitude_datum


def _image(
    scene: Scene,
    staged: StagedFile,
    metadata: ImageMetadata,
    inspection: Inspection,
    twin: Image | None,
    number: int,
) -> Image:
    verdict, reason, hint = inspection.verdict, inspection.reason, inspection.hint
    if twin is not None:
        verdict, reason = Verdict.DUPLICATE, f"{twin.name} has the same pixels."
        hint = "It adds no information and is not used."
    accepted = verdict is Verdict.ACCEPTED
    prior = _prior(metadata, inspection, scene)
    warnings = inspection.warnings
    if prior is not None and not _same_datum(prior, scene) and ImageWarning.POSITION_IGNORED not in warnings:
        warnings += (ImageWarning.POSITION_IGNORED,)
    return Image(
        digest=staged.digest,
        scene_id=scene.id,
        number=number,
        name=metadata.name or f"{staged.digest.removeprefix('sha256:')[:12]}",
        verdict=verdict,
        reason=reason,
        hint=hint,
        warnings=warnings,
        duplicate_of=None if twin is None else twin.digest,
        registration=Registration.PENDING if accepted else Registration.UNUSED,
        size_bytes=staged.size_bytes,
        format=inspection.format,
        width_px=inspection.width_px,
        height_px=inspection.height_px,
        focal_length_px=inspection.focal_length_px,
        sharpness=inspection.sharpness,
        prior=prior,
        captured_at=metadata.captured_at or inspection.captured_at,
        received_at=now(),
        every_s=(metadata.every_s or EVERY_S) if verdict is Verdict.VIDEO else None,
    )


def _prior(metadata: ImageMetadata, inspection: Inspection, scene: Scene) -> Prior | None:
    """The prior of the request, completed from the file: the position as a whole, angles one by one."""
    given, found = metadata.prior(), _prior_of(inspection, scene)
    if given is None or found is None:
        return found if given is None or not given.posed else given
    placed = given.geodetic or given.local
    rest = found.model_dump(exclude=set(_POSITION) if placed else None, exclude_none=True)
    both = {**rest, **given.model_dump(exclude_none=True)}
    if (found.geodetic and not placed) or not given.posed:
        both["source"] = found.source
    return Prior(**both)


def _prior_of(inspection: Inspection, scene: Scene) -> Prior | None:
    """The prior in the file's metadata; GPS and compass are useless in a local frame without north."""
    found = inspection.priors
    values = {"pitch_deg": found.pitch_deg, "roll_deg": found.roll_deg}
    if not isinstance(scene.world, LocalWorld):
        values["yaw_deg"] = found.yaw_deg
        values["height_above_takeoff_m"] = found.height_above_takeoff_m
        if found.latitude_deg is not None:
            values |= {
                "latitude_deg": found.latitude_deg,
                "longitude_deg": found.longitude_deg,
                "altitude_m": found.altitude_m,
            }
    given = {name: value for name, value in values.items() if value is not None}
    if not given:
        return None
    datum = AltitudeDatum.SEA_LEVEL if "altitude_m" in given else None
    return Prior(source=PriorSource.METADATA, altitude_datum=datum, **given)
