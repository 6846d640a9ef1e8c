"""What a scene is."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from fvs_service.model import Count, Model, Number, PositiveNumber, Timestamp, WholeNumber

Latitude = Annotated[Number, Field(ge=-90, le=90)]
Longitude = Annotated[Number, Field(ge=-180, le=180)]
Altitude = Annotated[Number, Field(ge=-12_000, le=100_000)]
Coordinate = Annotated[Number, Field(ge=-1e9, le=1e9)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
QuaternionPart = Annotated[Number, Field(ge=-1.01, le=1.01)]
Quaternion = tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]


class AltitudeDatum(StrEnum):
    """What altitudes are measured from."""

    ELLIPSOID = "ellipsoid"
    """WGS 84, what a bare GNSS receiver computes."""
    SEA_LEVEL = "sea-level"
    """The geoid, what EXIF means by altitude."""
    TAKEOFF = "takeoff"
    """Where the vehicle started."""


class Origin(Model):
    """Where the ENU world frame has its zero: x east, y north, z up, in metres. It never moves."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Altitude
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL


class AutomaticWorld(Model):
    """ENU metres about the first position that the images tell; the model's frame while there is none."""

    kind: Literal["automatic"] = "automatic"


class LocalWorld(Model):
    """Metres in a frame of yours (z up): positions of images are given in it; GPS is not used."""

    kind: Literal["local"]


class EnuWorld(Model):
    """ENU metres about an origin of yours."""

    kind: Literal["enu"]
    origin: Origin


World = Annotated[AutomaticWorld | LocalWorld | EnuWorld, Field(discriminator="kind")]


class CameraPrior(Model):
    """What is known of the camera beforehand, for images whose EXIF does not tell."""

    focal_length_px: PositiveNumber
    width_px: Annotated[WholeNumber, Field(gt=0, le=65_535)]
    """The image width that the focal length belongs to."""


class Trigger(StrEnum):
    """What starts an update by itself."""

    ON_REQUEST = "on-request"
    EACH_IMAGE = "each-image"
    EVERY_K_IMAGES = "every-k-images"


class Policy(Model):
    """When the scene is updated without being asked."""

    trigger: Trigger = Trigger.ON_REQUEST
    k: Annotated[WholeNumber, Field(ge=1, le=10_000)] = 10
    """With `every-k-images`: after so many new images."""
    first: Annotated[WholeNumber, Field(ge=2, le=10_000)] = 8
    """The first update waits for so many images: fewer seldom make a model."""


class SceneRequest(Model):
    """A scene to be made."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"name": "north quarry"},
                {
                    "name": "castle, first flight",
                    "world": {
                        "kind": "enu",
                        "origin": {"latitude_deg": 48.3014, "longitude_deg": 7.2511, "altitude_m": 412.0},
                    },
                    "policy": {"trigger": "every-k-images", "k": 5, "first": 8},
                },
            ]
        }
    )

    name: Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
    world: World = AutomaticWorld()
    camera: CameraPrior | None = None
    policy: Policy = Policy()


class AlignmentStatus(StrEnum):
    """How the model stands in the world."""

    MODEL = "model"
    """Nothing places it: the model's frame is the world."""
    ALIGNED = "aligned"
    ILL_CONDITIONED = "ill-conditioned"
    """The cameras stand on a line, so the turn about that line is open."""


class Alignment(Model):
    """The similarity that takes the model's frame to the world, and how well it fits."""

    status: AlignmentStatus = AlignmentStatus.MODEL
    scale: PositiveNumber = 1.0
    """World units (metres when aligned) per model unit."""
    rotation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    translation: Vector = (0.0, 0.0, 0.0)
    rms_m: Number | None = None
    inliers: Count = 0
    positions: Count = 0
    """How many registered images had a position."""


class ImageCounts(Model):
    """How many images were received, and what became of them."""

    received: Count = 0
    accepted: Count = 0
    rejected: Count = 0
    pending: Count = 0
    """Accepted, and not yet offered to an update."""


class Scene(Model):
    """One capture: its settings, its counts, and its latest snapshot."""

    id: str
    name: str
    world: World
    origin: Origin | None
    """The ENU origin, once there is one."""
    camera: CameraPrior | None
    policy: Policy
    images: ImageCounts
    snapshot_id: str | None
    alignment: Alignment | None
    """Of the latest snapshot."""
    created_at: Timestamp


class SceneList(Model):
    """Scenes, the oldest first; `next` continues the list."""

    items: tuple[Scene, ...]
    next: str | None
