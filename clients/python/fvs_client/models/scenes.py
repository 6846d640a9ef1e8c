"""Scenes, their worlds and policies."""

from typing import Annotated, Literal

from pydantic import Field

from fvs_client.models.base import Answer, Input, Quaternion, ReprArgs, Timestamp, Vector, Word
from fvs_client.models.tables import facts_html


class AltitudeDatum(Word):
    """Reference of altitudes."""

    ELLIPSOID = "ellipsoid"
    SEA_LEVEL = "sea-level"
    TAKEOFF = "takeoff"


class Origin(Input):
    """Origin of an ENU world (x east, y north, z up, in metres)."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL


class AutomaticWorld(Input):
    """ENU metres about the first position prior of the images; the model's frame without one."""

    kind: Literal["automatic"] = "automatic"


class LocalWorld(Input):
    """Metres in a frame of your own (z up), in which positions of images are given."""

    kind: Literal["local"] = "local"


class EnuWorld(Input):
    """ENU metres about a given origin."""

    kind: Literal["enu"] = "enu"
    origin: Origin


World = Annotated[AutomaticWorld | LocalWorld | EnuWorld, Field(discriminator="kind")]


class CameraPrior(Input):
    """Focal length prior for images without one in their EXIF data."""

    focal_length_px: float
    width_px: int
    """Image width that the focal length refers to."""


class Trigger(Word):
    """What starts an update."""

    ON_REQUEST = "on-request"
    EACH_IMAGE = "each-image"
    EVERY_K_IMAGES = "every-k-images"


class Policy(Input):
    """When the scene is updated automatically."""

    trigger: Trigger = Trigger.ON_REQUEST
    k: int = 10
    """Number of new images that start an update, with `every-k-images`."""
    first: int = 8
    """Number of images before the first update."""


class Retention(Input):
    """How long snapshots and rankings are kept; None means the service's setting.

    The current snapshot, the newest of each kind, and pinned ones always stay.
    """

    snapshots: int | None = None
    """Number of newest snapshots to keep."""
    snapshot_days: float | None = None
    rankings: int | None = None
    ranking_days: float | None = None
    plans: int | None = None
    """Number of newest plans to keep."""
    plan_days: float | None = None


class SceneChange(Input):
    """Changes to a scene; None leaves a setting as it is."""

    name: str | None = None
    policy: Policy | None = None
    retention: Retention | None = None


class SceneRequest(Input):
    """Settings of a new scene."""

    name: str
    world: World = AutomaticWorld()
    camera: CameraPrior | None = None
    policy: Policy = Policy()
    retention: Retention = Retention()


class SceneSize(Answer):
    """Disk space of a scene."""

    scene_id: str
    images_bytes: int
    artifacts_bytes: int
    working_bytes: int
    """The worker's files when the scene's last job ended."""
    total_bytes: int


class AlignmentStatus(Word):
    """How well the model is aligned with the world."""

    MODEL = "model"
    """Not aligned, for lack of position priors: the model's frame is the world."""
    ALIGNED = "aligned"
    ILL_CONDITIONED = "ill-conditioned"
    """The camera centres are collinear, so the rotation about their line is undetermined."""


class Alignment(Answer):
    """The similarity world_from_model, and how well it fits."""

    status: AlignmentStatus
    scale: float
    """World units (metres when aligned) per model unit."""
    rotation_wxyz: Quaternion
    translation: Vector
    rms_m: float | None
    inliers: int
    positions: int

    def with_unit(self, what: str) -> str:
        """A heading of lengths in the world frame, with their unit: there is none without an alignment."""
        return what if self.status is AlignmentStatus.MODEL else f"{what} (m)"


class ImageCounts(Answer):
    """Numbers of images by verdict and state."""

    received: int
    accepted: int
    rejected: int
    pending: int
    """Accepted, and not processed by an update yet."""
    excluded: int = 0
    """Accepted, and left out on request."""
    quarantined: int = 0
    """Accepted, and left out because they crash structure from motion."""


class SceneData(Answer):
    """A scene (one capture): its settings, image counts and latest snapshot."""

    id: str
    name: str
    world: World
    origin: Origin | None
    camera: CameraPrior | None
    policy: Policy
    retention: Retention = Retention()
    image_counts: ImageCounts = Field(validation_alias="images", serialization_alias="images")
    snapshot_id: str | None
    alignment: Alignment | None
    created_at: Timestamp
    etag: str
    """A tag of the scene as it is: it changes with every other field."""

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("name", self.name), ("images", self.image_counts.received))
        yield "snapshot_id", self.snapshot_id

    def _repr_html_(self) -> str:
        counts = self.image_counts
        images = f"{counts.received} received, {counts.accepted} accepted, {counts.pending} pending"
        facts = {"id": self.id, "images": images, "world": world_text(self)}
        facts |= {"model": self.snapshot_id or "none yet", "created": f"{self.created_at:%F %H:%M}"}
        return facts_html(f"Scene {self.name}", facts.items())


def world_text(scene: SceneData) -> str:
    """The world of a scene, and how well its model is aligned with it."""
    alignment = scene.alignment
    origin = scene.origin
    enu = f"ENU about {origin.latitude_deg:.6f}, {origin.longitude_deg:.6f}; " if origin is not None else ""
    if alignment is None:
        return f"{enu}{scene.world.kind}, no model to align yet"
    rms = (
        "" if alignment.rms_m is None else f", RMS {alignment.rms_m:.3f} m over {alignment.inliers} positions"
    )
    return f"{enu}{alignment.status.value}{rms}"
