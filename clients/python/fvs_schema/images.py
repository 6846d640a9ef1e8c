"""Images: verdicts, priors, uploads."""

from typing import Annotated, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from fvs_schema.base import Input, Listing, Output, Timestamp
from fvs_schema.checks import of_fields, within
from fvs_schema.findings import FindingCode
from fvs_schema.names import Digest, ImageName
from fvs_schema.quantities import (
    Altitude,
    AngleSigma,
    AsText,
    Coordinate,
    Count,
    Latitude,
    Longitude,
    Number,
    PositionSigma,
    PositiveNumber,
    Spacing,
    Tilt,
    Yaw,
)
from fvs_schema.scenes import AltitudeDatum
from fvs_schema.words import Word

_MOST_DIGESTS = 10_000
MEDIA_TYPES = {
    "JPEG": "image/jpeg",
    "MPO": "image/jpeg",
    "PNG": "image/png",
    "TIFF": "image/tiff",
    "WEBP": "image/webp",
    "BMP": "image/bmp",
}
"""Format → media type."""


class Verdict(Word):
    """Whether an image can be used."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    """Another image of the scene has the same pixels."""
    UNREADABLE = "unreadable"
    TOO_SMALL = "too-small"
    TOO_LARGE = "too-large"
    TOO_NARROW = "too-narrow"
    """One side is too long for the other."""
    VIDEO = "video"
    """A video, whose frames become images of the scene."""


class Registration(Word):
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


class ImageWarning(Word):
    """A warning about an accepted image."""

    BLURRED = "blurred"
    POSITION_IGNORED = "position-ignored"
    """Its position is impossible or unreadable, or its altitude has another datum than the scene's."""


class PriorSource(Word):
    """The source of a prior's position (of its angles when there is no position)."""

    REQUEST = "request"
    METADATA = "metadata"


class Prior(Output):
    """The pose of an image as far as it is known before structure from motion.

    Positions are geodetic or in the scene's local frame; angles are a vehicle's (yaw clockwise from north,
    pitch up, roll with the right side down). `position_sigma_m` and `attitude_sigma_deg` are standard
    deviations, of each coordinate and about each axis. Without them geodetic positions count as good to 5 m,
    local ones as exact, and attitudes as good to 10°.
    """

    source: PriorSource
    """Whether it comes from the request or from the file's metadata."""
    latitude_deg: float | None = None
    """Geodetic latitude on WGS 84, north positive."""
    longitude_deg: float | None = None
    """Longitude, east positive."""
    altitude_m: float | None = None
    """Altitude above `altitude_datum`."""
    altitude_datum: AltitudeDatum | None = None
    """What the altitude is measured from."""
    x_m: float | None = None
    """x in the scene's local frame."""
    y_m: float | None = None
    """y in the scene's local frame."""
    z_m: float | None = None
    """z in the scene's local frame, up."""
    yaw_deg: float | None = None
    """The camera's heading, clockwise from north."""
    pitch_deg: float | None = None
    """Up is positive: -90 looks straight down."""
    roll_deg: float | None = None
    """Positive with the right side down."""
    position_sigma_m: float | None = None
    """Standard deviation of each coordinate of the position."""
    attitude_sigma_deg: float | None = None
    """Standard deviation of the orientation about each axis."""
    height_above_takeoff_m: float | None = None
    """Height above the place where the vehicle took off, by its barometer; from the file."""

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


class ImageMetadata(Input):
    """Metadata from the sender, all optional; they override those in the file.

    Position and angles that are not given are read from the file. The standard deviations are of the position
    and angles that are used.
    """

    name: ImageName | None = Field(
        default=None, description="The name of the image, without folders; by default its digest."
    )
    captured_at: Timestamp | None = Field(default=None, description="When the photograph was taken.")
    latitude_deg: AsText[Latitude] | None = Field(
        default=None, description="Geodetic latitude on WGS 84, north positive."
    )
    longitude_deg: AsText[Longitude] | None = Field(default=None, description="Longitude, east positive.")
    altitude_m: AsText[Altitude] | None = Field(default=None, description="Altitude above `altitude_datum`.")
    altitude_datum: AltitudeDatum | None = Field(
        default=None, description="What the altitude is measured from; by default sea level."
    )
    x_m: AsText[Coordinate] | None = Field(default=None, description="x in the scene's local frame.")
    y_m: AsText[Coordinate] | None = Field(default=None, description="y in the scene's local frame.")
    z_m: AsText[Coordinate] | None = Field(default=None, description="z in the scene's local frame, up.")
    yaw_deg: AsText[Yaw] | None = Field(
        default=None, description="The camera's heading, clockwise from north."
    )
    pitch_deg: AsText[Tilt] | None = Field(
        default=None, description="Up is positive: -90 looks straight down."
    )
    roll_deg: AsText[Tilt] | None = Field(default=None, description="Positive with the right side down.")
    position_sigma_m: AsText[PositionSigma] | None = Field(
        default=None, description="Standard deviation of each coordinate of the position."
    )
    attitude_sigma_deg: AsText[AngleSigma] | None = Field(
        default=None, description="Standard deviation of the orientation about each axis."
    )
    every_s: AsText[Spacing] | None = Field(
        default=None, description="Spacing of the frames that are taken from a video; by default 1."
    )

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
        given = self.model_dump(exclude={"name", "captured_at", "every_s"}, exclude_none=True)
        if self.latitude_deg is not None:
            given.setdefault("altitude_datum", AltitudeDatum.SEA_LEVEL)
        return Prior(source=PriorSource.REQUEST, **given) if given else None


class Image(Output):
    """An image of a scene, its verdict and its registration."""

    digest: Digest
    """The SHA-256 of its bytes, which is its id in the scene."""
    scene_id: str
    """The scene."""
    number: Count
    """Counts in the order of arrival, of the image or of its mask."""
    name: str
    """The sender's name of it."""
    verdict: Verdict
    """Whether it can be used."""
    reason: str
    """Why it is not accepted, excluded, quarantined or unregistered; else empty."""
    hint: str
    """What to do about it; else empty."""
    finding: FindingCode | None = None
    """The kind of the reason why it is quarantined or unregistered, for programs; else null."""
    warnings: tuple[ImageWarning, ...]
    """Warnings about an accepted image."""
    mask: Digest | None = None
    """The SHA-256 of its mask; null when it has none."""
    duplicate_of: Digest | None
    """The image with the same pixels; null unless it is a duplicate."""
    registration: Registration
    """Whether it has a pose in the current model."""
    size_bytes: Count
    """The size of the file."""
    format: str | None
    """The format of the file, such as `JPEG`; null when it is unreadable."""
    width_px: Count | None
    """Width; null when it is unreadable."""
    height_px: Count | None
    """Height; null when it is unreadable."""
    focal_length_px: PositiveNumber | None
    """The focal length from its EXIF data or the scene's prior; null without one."""
    sharpness: Number | None
    """How sharp it is, for comparison with others of the scene; null when it is not accepted."""
    prior: Prior | None
    """What is known of its pose in advance; null if nothing is."""
    captured_at: Timestamp | None
    """When the photograph was taken; null when that is not known."""
    received_at: Timestamp
    """When it arrived."""
    video: Digest | None = None
    """The video from which it was taken; null when it is no frame of one."""
    every_s: Number | None = None
    """Of a video: the spacing of the frames that are taken; null for images."""
    frames: Count | None = None
    """Of a video: the number of images that were made from it; null until all are, and for images."""

    @property
    def accepted(self) -> bool:
        """Whether it can be used."""
        return self.verdict is Verdict.ACCEPTED

    @property
    def rejected(self) -> bool:
        """Whether it can neither be used nor, as a video, gives images that can."""
        return self.verdict not in (Verdict.ACCEPTED, Verdict.VIDEO)

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


class DigestCheck(Input):
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
        Field(min_length=1, max_length=_MOST_DIGESTS, fail_fast=True),
        within(_MOST_DIGESTS),
    ]
    """SHA-256 of the files, each `sha256:` and 64 hexadecimal digits."""


class KnownImage(Output):
    """An image that the scene has, and whether it can be used."""

    digest: Digest
    """The SHA-256 of its bytes."""
    verdict: Verdict
    """Whether it can be used."""
    reason: str
    """Why it is not accepted, excluded, quarantined or unregistered; else empty."""
    hint: str
    """What to do about it; else empty."""
    mask: Digest | None = None
    """The SHA-256 of its mask; null when it has none."""


class DigestAnswer(Output):
    """The digests that the scene has, and those that it lacks.

    The scene has images that are not accepted, too: it keeps their verdicts, and not their bytes.
    """

    known: tuple[Digest, ...]
    """Digests of images that the scene has."""
    missing: tuple[Digest, ...]
    """Digests of images to send."""
    images: tuple[KnownImage, ...]
    """Images that the scene has, with their verdicts, in the order of `known`."""


class UploadItem(Output):
    """The image of one file of a multipart upload."""

    name: str
    """The name of the file in the form."""
    created: bool
    """Whether it is new to the scene."""
    image: Image
    """The image, with its verdict."""


class RefusedMask(Output):
    """A mask of a multipart upload that no image has."""

    name: str
    """The name of the file in the form."""
    reason: str
    """Why it is not used."""
    hint: str
    """What to do about it."""


class UploadAnswer(Output):
    """The images of a multipart upload, in the order of its files, with the masks of the form."""

    items: tuple[UploadItem, ...]
    """An item for each image."""
    refused_masks: tuple[RefusedMask, ...]
    """The masks that are not used; their images are in the scene without them."""
