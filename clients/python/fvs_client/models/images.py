"""Images: what is sent, and what became of it."""

from datetime import datetime

from fvs_client.models.base import Answer, Input, Timestamp, Word
from fvs_client.models.scenes import AltitudeDatum


class Verdict(Word):
    """Whether an image can be used."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
    UNREADABLE = "unreadable"
    TOO_SMALL = "too-small"
    TOO_LARGE = "too-large"


class Registration(Word):
    """Whether structure from motion has found the image's place."""

    PENDING = "pending"
    REGISTERED = "registered"
    UNREGISTERED = "unregistered"
    UNUSED = "unused"


class ImageMetadata(Input):
    """What you know of an image; it wins over what the file says. All of it is optional.

    A position is geodetic (latitude, longitude and altitude) or, in a scene with a local world, x, y and z.
    Yaw is clockwise from north, pitch up, roll with the right side down.
    """

    name: str | None = None
    captured_at: datetime | None = None
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


class Prior(Answer):
    """Where an image was taken, as far as it was told: by the sender, or by the file."""

    source: str
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


class Image(Answer):
    """One photograph of a scene."""

    digest: str
    """``sha256:…`` of its bytes."""
    scene_id: str
    number: int
    """Its place in the order of arrival."""
    name: str
    verdict: Verdict
    reason: str
    """Why it is not accepted; empty when it is."""
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
        """Whether it can be used."""
        return self.verdict is Verdict.ACCEPTED


class DigestAnswer(Answer):
    """Which digests the scene has, and which are worth sending."""

    known: tuple[str, ...]
    missing: tuple[str, ...]
