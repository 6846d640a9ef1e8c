"""Images and their metadata."""

from datetime import datetime

from fvs_client.models.base import Answer, Input, Model, Timestamp, Word
from fvs_client.models.scenes import AltitudeDatum


class Verdict(Word):
    """Whether an image can be used."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    UNREADABLE = "unreadable"
    TOO_SMALL = "too-small"
    TOO_LARGE = "too-large"
    TOO_NARROW = "too-narrow"


class Registration(Word):
    """Whether the image has a pose in the current model."""

    PENDING = "pending"
    REGISTERED = "registered"
    UNREGISTERED = "unregistered"
    UNUSED = "unused"
    EXCLUDED = "excluded"
    QUARANTINED = "quarantined"


class _PosePrior(Model):
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


class ImageMetadata(_PosePrior, Input):
    """What is known of an image; it overrides the file's metadata. All fields are optional.

    A position is geodetic (latitude, longitude, altitude) or, in a scene with a local world, x, y and z. Yaw
    is clockwise from north, pitch up, roll right side down. The sigmas are standard deviations: of each
    coordinate of the position and about each axis, whether position and angles are given here or in the file.
    """

    name: str | None = None
    captured_at: datetime | None = None


class Prior(_PosePrior, Answer):
    """Position prior of an image; ``source`` is the sender or the file."""

    source: str


class Image(Answer):
    """An image of a scene."""

    digest: str
    """``sha256:…`` of its bytes."""
    scene_id: str
    number: int
    """Position in the order of arrival."""
    name: str
    verdict: Verdict
    reason: str
    """Why the image was not accepted, excluded or quarantined; empty otherwise."""
    hint: str
    warnings: tuple[str, ...]
    duplicate_of: str | None
    registration: Registration
    size_bytes: int
    format: str | None
    width_px: int | None
    height_px: int | None
    focal_length_px: float | None
    sharpness: float | None
    prior: Prior | None
    captured_at: Timestamp | None
    received_at: Timestamp

    @property
    def accepted(self) -> bool:
        """Whether the image can be used."""
        return self.verdict is Verdict.ACCEPTED


class KnownImage(Answer):
    """An image that a scene has, and whether it can be used."""

    digest: str
    verdict: Verdict
    reason: str
    hint: str


class DigestAnswer(Answer):
    """Which of the digests the scene has, and which it does not; ``images`` are the known ones, in order."""

    known: tuple[str, ...]
    missing: tuple[str, ...]
    images: tuple[KnownImage, ...]
