"""``manifest.json``: the settings, inputs and stages of an output folder."""

import importlib.metadata
from datetime import UTC, datetime
from typing import Any, Literal

from pydantic import AwareDatetime, Field

from fvs_engine.choices import CameraModel, Quality
from fvs_engine.records import Record
from fvs_engine.sfm.settings import KnownIntrinsics

DEFAULT_LONG_SIDE_PX: dict[Quality, int] = {"coarse": 640, "fine": 1600}
"""``fine`` is the 3DGS release's; ``coarse`` keeps a step on two CPU cores well under a second."""


Position = tuple[float, float, float]

CameraSource = Literal["photographs", "colmap", "transforms"]
"""Source of the cameras: structure from motion, or an imported model."""


class ReconstructionSettings(Record):
    """The settings of a reconstruction.

    ``iterations`` and ``long_side_px``: None takes the preset's. ``test_every``: of the views sorted by
    name, those with index % test_every == 0 are held out; 0 trains on all. ``colmap`` and ``transforms``:
    a folder or file with cameras to import instead of structure from motion. For structure from motion:
    ``camera_model`` is the one to estimate, None the default; ``intrinsics`` are known and do not change;
    without ``gps`` the positions in metadata are ignored.
    """

    quality: Quality = "coarse"
    iterations: int | None = Field(default=None, gt=0)
    long_side_px: int | None = Field(default=None, ge=64)
    test_every: int = Field(default=8, ge=0)
    seed: int = Field(default=0, ge=0)
    backend: str = "auto"
    colmap: str | None = None
    transforms: str | None = None
    camera_model: CameraModel | None = None
    intrinsics: KnownIntrinsics | None = None
    gps: bool = True

    @property
    def camera_source(self) -> CameraSource:
        """Where the cameras come from."""
        if self.colmap is not None:
            return "colmap"
        return "photographs" if self.transforms is None else "transforms"

    @property
    def training_long_side_px(self) -> int:
        """The long side that images are reduced to for training."""
        return self.long_side_px or DEFAULT_LONG_SIDE_PX[self.quality]


class ImageRecord(Record):
    """One photograph that was used: its name in the source folder and in ``images/``.

    ``as_stored``: though its EXIF says so, it is not turned, because its given camera belongs to the stored
    pixels.
    ``masked``: not all of it counts; ``mask_sha256``: the digest of the file with its mask.
    """

    name: str
    normalised_name: str
    sha256: str
    as_stored: bool = False
    masked: bool = False
    mask_sha256: str | None = None


class RejectionRecord(Record):
    """One file of the source folder that was not used, and why."""

    name: str
    reason: str
    hint: str


class ImagesRecord(Record):
    """The stage that checked and normalised the photographs."""

    folder: str
    photographs: tuple[ImageRecord, ...]
    rejected: tuple[RejectionRecord, ...]


class CamerasRecord(Record):
    """The stage that estimated (or imported) the cameras and undistorted the images.

    ``origin``: the zero of the folder's model frame in the coordinates of the imported model. Everything in
    the folder but ``ranking/`` and ``plan/`` is in the model frame.
    """

    source: CameraSource
    origin: Position = (0.0, 0.0, 0.0)
    registered: tuple[str, ...]
    unregistered: tuple[str, ...]
    points: int
    seconds: float
    report: dict[str, Any]


class TrainingRecord(Record):
    """The state of training.

    ``counted_shares``: name of a masked view trained on → the share of its image that counts.
    """

    train_views: tuple[str, ...]
    counted_shares: dict[str, float] = Field(default_factory=dict)
    test_views: tuple[str, ...]
    width_px: int
    height_px: int
    iterations: int
    target_iterations: int
    gaussians: int
    seconds: float


class Manifest(Record):
    """The manifest of an output folder; a stage's record is there once the stage is finished."""

    version: Literal[1] = 1
    program: str = Field(default_factory=lambda: f"fvs {importlib.metadata.version('fvs')}")
    created: AwareDatetime = Field(default_factory=lambda: datetime.now(UTC))
    settings: ReconstructionSettings
    images: ImagesRecord
    cameras: CamerasRecord | None = None
    training: TrainingRecord | None = None


class ViewMetrics(Record):
    """Quality of the render of one held-out view."""

    name: str
    psnr_db: float
    ssim: float


class Metrics(Record):
    """``metrics.json``: quality and cost of the model; ``views`` are the held-out ones."""

    views: tuple[ViewMetrics, ...]
    psnr_db: float | None
    ssim: float | None
    iterations: int
    gaussians: int
    training_seconds: float
    peak_memory_bytes: int
