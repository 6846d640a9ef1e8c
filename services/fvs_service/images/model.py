"""Images: verdicts, priors, uploads."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from fvs_service.model import (
    Count,
    Digest,
    Listing,
    Model,
    Number,
    PositiveNumber,
    Timestamp,
    of_fields,
    within,
)
from fvs_service.quantities import (
    Altitude,
    AngleSigma,
    AsText,
    Coordinate,
    Latitude,
    Longitude,
    PositionSigma,
    Tilt,
    Yaw,
)
from fvs_service.scenes.model import AltitudeDatum

IMAGE_NAME = r"^[^/\\\x00-\x1f\x7f]+$"
ImageName = Annotated[str, Field(min_length=1, max_length=255, pattern=IMAGE_NAME)]
"""The sender's name of the image; it is never a path."""


MEDIA_TYPES = {
    "JPEG": "image/jpeg",
    "MPO": "image/jpeg",
    "PNG": "image/png",
    "TIFF": "image/tiff",
    "WEBP": "image/webp",
    "BMP": "image/bmp",
}
"""Format → media type."""


class Verdict(StrEnum):
    """Whether an image can be used."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    """Another image of the scene has the same pixels."""
    UNREADABLE = "unreadable"
    TOO_SMALL = "too-small"
    TOO_LARGE = "too-large"
    TOO_NARROW = "too-narrow"
    """One side is too long for the other."""


class Registration(StrEnum):
    """Whether the image has a pose in the current model."""

    PENDING = "pending"
    """No update has processed it yet."""
    REGISTERED = "registered"
    UNREGISTERED = "unregistered"
    """It has no pose so far; `reason` says why. It is tried again when the images around it change."""
    UNUSED = "unused"
    """Not accepted, so never part of a model."""
    EXCLUDED = "excluded"
    """Left out on request; the next update makes a model without it."""
    QUARANTINED = "quarantined"
    """Left out because it crashes structure from motion; `reason` names the stage and the cause."""

    @property
    def left_out(self) -> bool:
        """Whether updates leave the image out until it is included again."""
        return self in (Registration.EXCLUDED, Registration.QUARANTINED)


class ImageWarning(StrEnum):
    """A warning about an accepted image."""

    BLURRED = "blurred"
    POSITION_IGNORED = "position-ignored"
    """Its position is impossible or unreadable, or its altitude has another datum than the scene's."""


class PriorSource(StrEnum):
    """The source of a prior's position (of its angles when there is no position)."""

    REQUEST = "request"
    METADATA = "metadata"


class Prior(Model):
    """The pose of an image as far as it is known before structure from motion.

    Positions are geodetic or in the scene's local frame; angles are a vehicle's (yaw clockwise from north,
    pitch up, roll with the right side down). `position_sigma_m` and `attitude_sigma_deg` are standard
    deviations, of each coordinate and about each axis. Without them geodetic positions count as good to 5 m,
    local ones as exact, and attitudes as good to 10°.
    """

    source: PriorSource
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    altitude_datum: AltitudeDatum | None = None
    x_m: float | None = None
    y_m: float | None = None
    z_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    position_sigma_m: float | None = None
    attitude_sigma_deg: float | None = None

    @property
    def geodetic(self) -> bool:
        """Whether it has a geodetic position."""
        return self.latitude_deg is not None

    @property
    def local(self) -> bool:
        """Whether it has a position in the scene's local frame."""
        return self.x_m is not None

    @property
    def posed(self) -> bool:
        """Whether it has a position or an angle, not only standard deviations."""
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg)
        return self.geodetic or self.local or any(angle is not None for angle in angles)


class ImageMetadata(Model):
    """Metadata from the sender, all optional; they override those in the file.

    Position and angles that are not given are read from the file. The standard deviations are of the position
    and angles that are used.
    """

    name: ImageName | None = None
    captured_at: Timestamp | None = None
    latitude_deg: AsText[Latitude] | None = None
    longitude_deg: AsText[Longitude] | None = None
    altitude_m: AsText[Altitude] | None = None
    altitude_datum: AltitudeDatum | None = None
    x_m: AsText[Coordinate] | None = None
    y_m: AsText[Coordinate] | None = None
    z_m: AsText[Coordinate] | None = None
    yaw_deg: AsText[Yaw] | None = None
    pitch_deg: AsText[Tilt] | None = None
    roll_deg: AsText[Tilt] | None = None
    position_sigma_m: AsText[PositionSigma] | None = None
    attitude_sigma_deg: AsText[AngleSigma] | None = None

    @field_validator("name")
    @classmethod
    def _no_folder(cls, name: str | None) -> str | None:
        if name in (".", ".."):
            raise ValueError("a name, not a folder")
        return name

    @model_validator(mode="after")
    def _whole_positions(self) -> Self:
        geodetic, local = ("latitude_deg", "longitude_deg", "altitude_m"), ("x_m", "y_m", "z_m")
        for first, second, third in (geodetic, local):
            missing = [name for name in (first, second, third) if getattr(self, name) is None]
            if 0 < len(missing) < 3:
                raise of_fields(f"{first}, {second} and {third} belong together", *missing)
        if self.latitude_deg is not None and self.x_m is not None:
            raise of_fields("a position is geodetic or local, not both", *geodetic, *local)
        if self.altitude_datum is not None and self.altitude_m is None:
            raise of_fields("altitude_datum needs an altitude_m", "altitude_m")
        return self

    def prior(self) -> Prior | None:
        """The prior of the request; None when nothing of it is given."""
        given = self.model_dump(exclude={"name", "captured_at"}, exclude_none=True)
        if self.latitude_deg is not None:
            given.setdefault("altitude_datum", AltitudeDatum.SEA_LEVEL)
        return Prior(source=PriorSource.REQUEST, **given) if given else None


class Image(Model):
    """An image of a scene, its verdict and its registration."""

    digest: Digest
    scene_id: str
    number: Count
    """Counts in the order of arrival."""
    name: str
    verdict: Verdict
    reason: str
    """Why it is not accepted, excluded, quarantined or unregistered; else empty."""
    hint: str
    warnings: tuple[ImageWarning, ...]
    duplicate_of: Digest | None
    registration: Registration
    size_bytes: Count
    format: str | None
    width_px: Count | None
    height_px: Count | None
    focal_length_px: PositiveNumber | None
    sharpness: Number | None
    prior: Prior | None
    captured_at: Timestamp | None
    received_at: Timestamp

    @property
    def sha256(self) -> str:
        """The digest without its prefix."""
        return self.digest.removeprefix("sha256:")

    @property
    def media_type(self) -> str:
        """The media type of its bytes."""
        return MEDIA_TYPES.get(self.format or "", "application/octet-stream")


class ImageList(Listing[Image]):
    """Images of a scene in the order of arrival."""


class DigestCheck(Model):
    """Digests of images that may be sent."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"digests": ["sha256:e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"]}
            ]
        }
    )

    digests: Annotated[
        tuple[Digest, ...],
        Field(min_length=1, max_length=10_000, fail_fast=True),
        within("digests_per_check"),
    ]


class KnownImage(Model):
    """An image that the scene has, and whether it can be used."""

    digest: Digest
    verdict: Verdict
    reason: str
    """Why it is not accepted, excluded, quarantined or unregistered; else empty."""
    hint: str


class DigestAnswer(Model):
    """The digests that the scene has, and those that it lacks.

    The scene has images that are not accepted, too: it keeps their verdicts, and not their bytes.
    """

    known: tuple[Digest, ...]
    missing: tuple[Digest, ...]
    images: tuple[KnownImage, ...]
    """Images that the scene has, with their verdicts, in the order of `known`."""


class UploadItem(Model):
    """The image of one file of a multipart upload."""

    name: str
    created: bool
    """Whether it is new to the scene."""
    image: Image


class UploadAnswer(Model):
    """The images of a multipart upload, in the order of its files."""

    items: tuple[UploadItem, ...]
