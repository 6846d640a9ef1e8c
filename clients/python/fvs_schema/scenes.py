"""Scenes: requests, settings, alignment."""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from fvs_schema.base import Input, Listing, Output, Page, Timestamp
from fvs_schema.checks import of_fields
from fvs_schema.jobs import JobKind, JobState
from fvs_schema.names import SceneName
from fvs_schema.quantities import (
    PLAUSIBLE_SHARE,
    WHOLE,
    Altitude,
    Count,
    Days,
    FocalLength,
    ImageWidth,
    Latitude,
    Longitude,
    Number,
    PositiveNumber,
    Quaternion,
    Triple,
)
from fvs_schema.words import Word


class AltitudeDatum(Word):
    """The surface or point from which altitudes are measured."""

    ELLIPSOID = "ellipsoid"
    """WGS 84, as GNSS receivers compute it."""
    SEA_LEVEL = "sea-level"
    """The geoid, as in EXIF."""
    TAKEOFF = "takeoff"
    """The point of takeoff."""

    @property
    def in_words(self) -> str:
        """What altitudes are above, in words."""
        names = {"ellipsoid": "the ellipsoid", "sea-level": "sea level", "takeoff": "the place of takeoff"}
        return names[self.value]


class Origin(Input):
    """The origin of the ENU world frame (x east, y north, z up, in metres). It never moves."""

    latitude_deg: Latitude
    """Geodetic latitude on WGS 84, north positive."""
    longitude_deg: Longitude
    """Longitude, east positive."""
    altitude_m: Altitude
    """Altitude above `altitude_datum`."""
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL
    """What the altitude is measured from."""


class AutomaticWorld(Input):
    """ENU, in metres, with the first position prior as origin; the model frame while there is none."""

    kind: Literal["automatic"] = "automatic"
    """The frame follows from the images."""


class LocalWorld(Input):
    """A frame of your own, z up, in metres: positions of images are given in it, and GPS is ignored."""

    kind: Literal["local"] = "local"
    """The frame is your own."""


class EnuWorld(Input):
    """ENU, in metres, with an origin of your own."""

    kind: Literal["enu"] = "enu"
    """The frame has an origin on Earth."""
    origin: Origin
    """Where x, y and z are 0."""


World = Annotated[AutomaticWorld | LocalWorld | EnuWorld, Field(discriminator="kind")]


class CameraPrior(Input):
    """A focal length prior for images without one in their EXIF."""

    width_px: ImageWidth
    """The image width to which the focal length applies."""
    focal_length_px: FocalLength
    """Focal lengths from 0.1 to 20 widths: fields of view from 157° to 3°."""

    @field_validator("focal_length_px")
    @classmethod
    def _fits_the_width(cls, value: float, info: ValidationInfo) -> float:
        width = info.data.get("width_px")
        if width is not None and not PLAUSIBLE_SHARE[0] <= value / width <= PLAUSIBLE_SHARE[1]:
            raise ValueError(
                f"a focal length from {PLAUSIBLE_SHARE[0]:g} to {PLAUSIBLE_SHARE[1]:g} widths of {width} px"
            )
        return value


class Trigger(Word):
    """What starts updates automatically."""

    ON_REQUEST = "on-request"
    EACH_IMAGE = "each-image"
    EVERY_K_IMAGES = "every-k-images"


class Policy(Input):
    """When updates start automatically."""

    trigger: Trigger = Trigger.ON_REQUEST
    """What starts an update."""
    k: Annotated[int, Field(strict=True, ge=1, le=10_000), WHOLE] = 10
    """The number of new images that start an update, with `every-k-images`."""
    first: Annotated[int, Field(strict=True, ge=2, le=10_000), WHOLE] = 8
    """The number of images before the first update; fewer are seldom enough for a model."""


class Retention(Input):
    """How long snapshots, rankings and plans are kept; null means the service's setting.

    A scene's current snapshot, its newest of each kind, and pinned ones always stay.
    """

    snapshots: Annotated[int, Field(strict=True, ge=1, le=100_000), WHOLE] | None = None
    """Number of newest snapshots to keep."""
    snapshot_days: Days | None = None
    """Maximum age of snapshots."""
    rankings: Annotated[int, Field(strict=True, ge=1, le=1_000_000), WHOLE] | None = None
    """Number of newest rankings to keep."""
    ranking_days: Days | None = None
    """Maximum age of rankings."""
    plans: Annotated[int, Field(strict=True, ge=1, le=1_000_000), WHOLE] | None = None
    """Number of newest plans to keep."""
    plan_days: Days | None = None
    """Maximum age of plans."""


class SceneRequest(Input):
    """A scene to create."""

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

    name: SceneName
    """A name for people; several scenes may have the same."""
    world: World = AutomaticWorld()
    """The frame of poses and positions; by default automatic."""
    camera: CameraPrior | None = None
    """A focal length prior for images without one in their EXIF."""
    policy: Policy = Policy()
    """When updates start by themselves; by default on request only."""
    retention: Retention = Retention()
    """What is kept; by default as the service is set."""


class SceneChange(Input):
    """Changes to a scene; settings that are not given stay."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"name": "south quarry"}, {"retention": {"snapshots": 10}}]}
    )

    name: SceneName | None = None
    """The new name."""
    policy: Policy | None = None
    """The new policy, as a whole."""
    retention: Retention | None = None
    """The new retention, as a whole."""

    @model_validator(mode="after")
    def _changes_something(self) -> Self:
        if not self.model_dump(exclude_none=True):
            raise of_fields("give a name, a policy or a retention", "name", "policy", "retention")
        return self


class SceneSize(Output):
    """The disk space of a scene."""

    scene_id: str
    """The scene."""
    images_bytes: Count
    """The original images and their thumbnails."""
    artifacts_bytes: Count
    """The artifacts of its snapshots; equal ones count once."""
    working_bytes: Count
    """The worker's files when its last job ended; a worker makes most of them again when they are lost."""
    total_bytes: Count
    """The sum of these."""


class AlignmentStatus(Word):
    """Whether the model is aligned with the world frame."""

    MODEL = "model"
    """Not aligned: the world frame is the model frame."""
    ALIGNED = "aligned"
    ILL_CONDITIONED = "ill-conditioned"
    """Aligned, but the cameras lie on a line, so the rotation about it is uncertain."""


class AlignmentSource(Word):
    """What the alignment with the world frame is from."""

    POSITIONS = "positions"
    """The position priors of the images, as GPS gives them."""
    CONTROL_POINTS = "control-points"
    """Surveyed points that are marked in the images."""


class Alignment(Output):
    """The similarity world_from_model, and how well it fits."""

    status: AlignmentStatus = AlignmentStatus.MODEL
    """Whether there is an alignment, and whether it can be relied on."""
    source: AlignmentSource = AlignmentSource.POSITIONS
    """What it is from."""
    scale: PositiveNumber = 1.0
    """World units (metres when aligned) per model unit."""
    rotation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """The rotation from the model to the world frame."""
    translation: Triple = (0.0, 0.0, 0.0)
    """Where the model's origin is in the world frame."""
    rms_m: Number | None = None
    """The root mean square of the distances between positions and their priors, or of control points from
    where they were surveyed; null when not aligned."""
    inliers: Count = 0
    """The number of images whose position prior fits, or of control points that fit."""
    positions: Count = 0
    """The number of registered images with a position prior, or of control points."""
    takeoff_altitude_m: Number | None = None
    """Where the flight of the newest photographs took off, above the datum of the scene's altitudes: their
    altitudes in the model less their heights above takeoff. Null where they have none."""


class ImageCounts(Output):
    """Numbers of images."""

    received: Count = 0
    """All images, accepted or not; videos do not count, but their frames do."""
    accepted: Count = 0
    """Images that can be used."""
    rejected: Count = 0
    """Images that cannot be used; their verdicts say why."""
    pending: Count = 0
    """Accepted, and not yet processed by an update."""
    excluded: Count = 0
    """Accepted, and left out on request."""
    quarantined: Count = 0
    """Accepted, and left out because they crash structure from motion."""

    @property
    def usable(self) -> int:
        """The number of images that an update uses."""
        return self.accepted - self.excluded - self.quarantined


class SceneJob(Output):
    """The job of a scene that runs, or else the one that has waited longest."""

    id: str
    """The id, `job_…`."""
    kind: JobKind
    """What it does."""
    state: JobState
    """Whether it is queued or runs."""


class Scene(Output):
    """A scene: its settings, its numbers of images, its latest snapshot, and what is done with it."""

    id: str
    """The id, `scn_…`."""
    name: str
    """The name for people."""
    world: World
    """The frame of poses and positions."""
    origin: Origin | None
    """The ENU origin; null while there is none."""
    camera: CameraPrior | None
    """The focal length prior for images without one in their EXIF; null without it."""
    policy: Policy
    """When updates start by themselves."""
    retention: Retention
    """How long snapshots and rankings are kept."""
    image_counts: ImageCounts
    """Numbers of images."""
    snapshot_id: str | None
    """The latest snapshot; null before the first update."""
    snapshot_created_at: Timestamp | None = None
    """When the latest snapshot was made; null before the first update."""
    alignment: Alignment | None
    """The alignment of the latest snapshot."""
    job: SceneJob | None = None
    """The job that runs, or else the one that has waited longest; null when there is nothing to do."""
    created_at: Timestamp
    """When it was created."""

    etag: str
    """A tag of the scene as it is: it changes with every other field."""


class ScenePage(Page):
    """A page of the list of scenes."""

    name: SceneName | None = Field(default=None, description="Only scenes with this name.")
    search: SceneName | None = Field(
        default=None, description="Only scenes whose name contains this, in upper or lower case."
    )


class SceneList(Listing[Scene]):
    """Scenes, the newest first."""
