"""What a snapshot is."""

from typing import Annotated

from pydantic import Field

from fvs_service.jobs.model import JobKind
from fvs_service.model import Count, Digest, Model, Number, PositiveNumber, Timestamp
from fvs_service.scenes.model import Alignment, Quaternion, Vector

ARTIFACT_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"

MEDIA_TYPES = {
    ".ply": "application/ply",
    ".spz": "application/octet-stream",
    ".json": "application/json",
    ".zip": "application/zip",
    ".safetensors": "application/octet-stream",
}


class Artifact(Model):
    """One file of a snapshot."""

    name: Annotated[str, Field(pattern=ARTIFACT_NAME)]
    media_type: str
    size_bytes: Count
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class SnapshotMetrics(Model):
    """How large and how good the model is."""

    registered: Count
    """Images with a pose in the model."""
    unregistered: Count
    """Accepted images that the update processed and that have no pose in the model."""
    points: Count
    iterations: Count
    gaussians: Count
    sh_degree: Count
    psnr_db: Number | None = None
    """Over the images that a fine model was kept from (`test_every`); null when it learned from all."""
    ssim: Number | None = None
    """Over the same images."""
    new_images_psnr_db: Number | None = None
    """What the snapshot before made of the images that are new in this one, which it had not seen: a measure
    that costs no image. Null where there was none before, or nothing is new."""


class Snapshot(Model):
    """An immutable model: cameras, points, Gaussians, metrics and its place in the world."""

    id: str
    scene_id: str
    job_id: str
    kind: JobKind
    metrics: SnapshotMetrics
    alignment: Alignment
    artifacts: tuple[Artifact, ...]
    created_at: Timestamp


class SnapshotList(Model):
    """Snapshots of a scene, the oldest first."""

    items: tuple[Snapshot, ...]
    next: str | None


class PinholeIntrinsics(Model):
    """A pinhole camera, in px."""

    width_px: Annotated[int, Field(gt=0)]
    height_px: Annotated[int, Field(gt=0)]
    fx_px: PositiveNumber
    fy_px: PositiveNumber
    cx_px: Number
    cy_px: Number


class SnapshotView(Model):
    """A registered image: its camera's place in the model's frame (model_from_camera)."""

    image: Digest
    name: str
    position: Vector
    orientation_wxyz: Quaternion


class SnapshotCameras(Model):
    """The artefact `cameras.json`: where the registered images were taken, in the model's frame.

    ``camera`` is the one that most images have, at the size that rankings are rendered; ``centre`` is the
    middle of what the model shows, ``up`` its upward direction, ``lower`` and ``upper`` a box around its
    points.
    """

    camera: PinholeIntrinsics
    views: tuple[SnapshotView, ...]
    centre: Vector
    up: Vector
    lower: Vector
    upper: Vector
