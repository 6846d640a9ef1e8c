"""Snapshots, their metrics, artifacts and cameras."""

from typing import Annotated

from pydantic import ConfigDict, Field

from fvs_schema.base import Input, Listing, Output, Timestamp
from fvs_schema.control_points import ControlResiduals
from fvs_schema.jobs import JobKind
from fvs_schema.names import Digest
from fvs_schema.quantities import Count, Number, PositiveNumber, Quaternion, Triple
from fvs_schema.scenes import Alignment, Origin

ARTIFACT_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"


class Artifact(Output):
    """One file of a snapshot."""

    name: Annotated[str, Field(pattern=ARTIFACT_NAME)]
    """The name of the file."""
    media_type: str
    """Its media type."""
    size_bytes: Count
    """Its size."""
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    """The SHA-256 of its bytes, in hexadecimal."""


class SnapshotMetrics(Output):
    """The size and the quality of a model."""

    registered: Count
    """Images with a pose in the model."""
    unregistered: Count
    """Accepted images that the update processed and that have no pose in the model."""
    points: Count
    """The number of sparse points."""
    iterations: Count
    """The number of training iterations."""
    gaussians: Count
    """The number of Gaussians."""
    sh_degree: Count
    """The degree of the spherical harmonics of their colours."""
    psnr_db: Number | None = None
    """Mean over the held-out images of a fine model (`test_every`); null without held-out images."""
    ssim: Number | None = None
    """Mean over the same images."""
    new_images_psnr_db: Number | None = None
    """How well the previous snapshot rendered the images that are new in this one, before it was trained on
    them: a measure of quality that holds out no image. Null without a previous snapshot or new images."""


class SnapshotAlignment(Alignment):
    """The artifact `alignment.json`: where a snapshot is on Earth."""

    origin: Origin | None = None
    """The origin of the world frame, in which the alignment is; null where it has none on Earth."""


class Snapshot(Output):
    """An immutable model: cameras, points, Gaussians, metrics and its alignment with the world."""

    id: str
    """The id, `snp_…`."""
    scene_id: str
    """The scene."""
    job_id: str
    """The job that made it."""
    kind: JobKind
    """The kind of that job."""
    metrics: SnapshotMetrics
    """Its size and its quality."""
    alignment: Alignment
    """Its alignment with the world."""
    control: ControlResiduals | None = None
    """How well it fits the control points that align it; null where none do."""
    artifacts: tuple[Artifact, ...]
    """Its files."""
    pinned: bool = False
    """Whether it is pinned: retention never deletes it."""
    created_at: Timestamp
    """When it was made."""


class SnapshotChange(Input):
    """Changes to a snapshot."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"pinned": True}]})

    pinned: bool
    """Whether to keep it, whatever the retention says."""


class SnapshotList(Listing[Snapshot]):
    """Snapshots of a scene, the newest first."""


class PinholeIntrinsics(Output):
    """A pinhole camera, in px."""

    width_px: Annotated[int, Field(gt=0)]
    """Width of its images."""
    height_px: Annotated[int, Field(gt=0)]
    """Height of its images."""
    fx_px: PositiveNumber
    """Focal length along x."""
    fy_px: PositiveNumber
    """Focal length along y."""
    cx_px: Number
    """x of the principal point."""
    cy_px: Number
    """y of the principal point."""


class SnapshotView(Output):
    """A registered image and its camera's pose in the model frame (model_from_camera)."""

    image: Digest
    """The SHA-256 of its bytes."""
    name: str
    """The sender's name of it."""
    position: Triple
    """The camera's centre."""
    orientation_wxyz: Quaternion
    """The rotation from the camera to the model frame."""
    counted_share: Annotated[float, Field(ge=0, le=1)] = 1.0
    """The share of the image that its mask keeps; 1 without one."""


class SnapshotCameras(Output):
    """The artifact `cameras.json`: the poses of the registered images, in the model frame."""

    camera: PinholeIntrinsics
    """The camera of most images, at the size at which rankings are rendered."""
    views: tuple[SnapshotView, ...]
    """The registered images."""
    centre: Triple
    """The median of the model's points."""
    up: Triple
    """The upward direction."""
    lower: Triple
    """The lower corner of a box around the points."""
    upper: Triple
    """The upper corner of that box."""
