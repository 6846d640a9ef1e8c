"""Snapshots: immutable models, and their files."""

from fvs_client.models.base import Answer, Quaternion, Timestamp, Vector
from fvs_client.models.jobs import JobKind
from fvs_client.models.scenes import Alignment


class Artifact(Answer):
    """One file of a snapshot."""

    name: str
    media_type: str
    size_bytes: int
    sha256: str


class SnapshotMetrics(Answer):
    """How large and how good the model is."""

    registered: int
    """Images that have their place."""
    unregistered: int
    """Accepted images that overlap with nothing yet."""
    points: int
    iterations: int
    gaussians: int
    sh_degree: int
    psnr_db: float | None
    """Over the images that a fine model was kept from (``test_every``)."""
    ssim: float | None
    new_images_psnr_db: float | None = None
    """What the snapshot before made of the images that are new in this one, which it had not seen."""


class SnapshotData(Answer):
    """An immutable model: its metrics, its place in the world, and the files it consists of."""

    id: str
    scene_id: str
    job_id: str
    kind: JobKind
    metrics: SnapshotMetrics
    alignment: Alignment
    artifacts: tuple[Artifact, ...]
    created_at: Timestamp


class PinholeIntrinsics(Answer):
    """A pinhole camera, in px."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


class SnapshotView(Answer):
    """A registered image: its camera's place in the model's frame (model_from_camera)."""

    image: str
    name: str
    position: Vector
    orientation_wxyz: Quaternion


class SnapshotCameras(Answer):
    """What `cameras.json` says: where the registered images were taken, in the model's frame.

    ``centre`` is the middle of what the model shows, ``up`` its upward direction, ``lower`` and ``upper`` a
    box around its points.
    """

    camera: PinholeIntrinsics
    views: tuple[SnapshotView, ...]
    centre: Vector
    up: Vector
    lower: Vector
    upper: Vector
