"""Snapshots: immutable models and their artifacts."""

from fvs_client.models.base import Answer, Quaternion, ReprArgs, Timestamp, Vector
from fvs_client.models.jobs import JobKind
from fvs_client.models.scenes import Alignment


class Artifact(Answer):
    """A file of a snapshot."""

    name: str
    media_type: str
    size_bytes: int
    sha256: str


class SnapshotMetrics(Answer):
    """Size and quality of the model."""

    registered: int
    """Images with a pose in the model."""
    unregistered: int
    """Accepted images that the update processed and that have no pose in the model."""
    points: int
    iterations: int
    gaussians: int
    sh_degree: int
    psnr_db: float | None
    """Over the held-out views of a fine model (``test_every``)."""
    ssim: float | None
    new_images_psnr_db: float | None = None
    """How well the previous snapshot renders the images that are new in this one, before training on them."""


class SnapshotData(Answer):
    """An immutable model: its metrics, alignment and artifacts."""

    id: str
    scene_id: str
    job_id: str
    kind: JobKind
    metrics: SnapshotMetrics
    alignment: Alignment
    artifacts: tuple[Artifact, ...]
    pinned: bool = False
    """Whether it is pinned: retention never deletes it."""
    created_at: Timestamp

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("kind", self.kind.value))
        yield from (("registered", self.metrics.registered), ("gaussians", self.metrics.gaussians))


class PinholeIntrinsics(Answer):
    """Intrinsics of a pinhole camera."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


class SnapshotView(Answer):
    """A registered image and its pose in the model's frame (model_from_camera)."""

    image: str
    name: str
    position: Vector
    orientation_wxyz: Quaternion


class SnapshotCameras(Answer):
    """The content of `cameras.json`: cameras of the registered images, in the model's frame.

    ``camera`` is the camera of most images. ``centre`` is the median of the model's points, ``up`` the upward
    direction, ``lower`` and ``upper`` are the corners of a box around the points.
    """

    camera: PinholeIntrinsics
    views: tuple[SnapshotView, ...]
    centre: Vector
    up: Vector
    lower: Vector
    upper: Vector
