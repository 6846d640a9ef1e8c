"""Scenes: one per capture."""

from typing import Annotated, Literal

from pydantic import Field

from fvs_client.models.base import Answer, Input, Quaternion, Timestamp, Vector, Word


class AltitudeDatum(Word):
    """What altitudes are measured from."""

    ELLIPSOID = "ellipsoid"
    SEA_LEVEL = "sea-level"
    TAKEOFF = "takeoff"


class Origin(Input):
    """Where an ENU world has its zero: x east, y north, z up, in metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL


class AutomaticWorld(Input):
    """ENU metres about the first position that the images tell; the model's frame while there is none."""

    kind: Literal["automatic"] = "automatic"


class LocalWorld(Input):
    """Metres in a frame of yours (z up): positions of images are given in it."""

    kind: Literal["local"] = "local"


class EnuWorld(Input):
    """ENU metres about an origin of yours."""

    kind: Literal["enu"] = "enu"
    origin: Origin


World = Annotated[AutomaticWorld | LocalWorld | EnuWorld, Field(discriminator="kind")]


class CameraPrior(Input):
    """What is known of the camera beforehand, for images whose EXIF does not tell."""

    focal_length_px: float
    width_px: int
    """The image width that the focal length belongs to."""


class Trigger(Word):
    """What starts an update by itself."""

    ON_REQUEST = "on-request"
    EACH_IMAGE = "each-image"
    EVERY_K_IMAGES = "every-k-images"


class Policy(Input):
    """When the scene is updated without being asked."""

    trigger: Trigger = Trigger.ON_REQUEST
    k: int = 10
    """With `every-k-images`: after so many new images."""
    first: int = 8
    """The first update waits for so many images."""


class SceneRequest(Input):
    """A scene to be made."""

    name: str
    world: World = AutomaticWorld()
    camera: CameraPrior | None = None
    policy: Policy = Policy()


class AlignmentStatus(Word):
    """How the model stands in the world."""

    MODEL = "model"
    """Nothing places it: the model's frame is the world."""
    ALIGNED = "aligned"
    ILL_CONDITIONED = "ill-conditioned"
    """The cameras stand on a line, so the turn about that line is open."""


class Alignment(Answer):
    """The similarity that takes the model's frame to the world, and how well it fits."""

    status: AlignmentStatus
    scale: float
    """World units (metres when aligned) per model unit."""
    rotation_wxyz: Quaternion
    translation: Vector
    rms_m: float | None
    inliers: int
    positions: int


class ImageCounts(Answer):
    """How many images were received, and what became of them."""

    received: int
    accepted: int
    rejected: int
    pending: int
    """Accepted, and not yet offered to an update."""


class SceneData(Answer):
    """One capture: its settings, its counts, and its latest snapshot."""

    id: str
    name: str
    world: World
    origin: Origin | None
    camera: CameraPrior | None
    policy: Policy
    image_counts: ImageCounts = Field(alias="images")
    snapshot_id: str | None
    alignment: Alignment | None
    created_at: Timestamp
