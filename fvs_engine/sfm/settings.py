"""Settings of structure from motion."""

from typing import Literal

from pydantic import Field, model_validator

from fvs_engine.choices import CameraModel
from fvs_engine.geometry.alignment.positions import MAX_MISPLACED_SHARE
from fvs_engine.geometry.cameras import MAX_SIDE_PX, DistortedCamera
from fvs_engine.records import Record
from fvs_schema.quantities import PLAUSIBLE_SHARE

MapperName = Literal["incremental", "global"]
"""COLMAP's two mappers."""


class KnownIntrinsics(Record):
    """A calibration of all images (of its shape, at any size): COLMAP's model name and parameters."""

    model: str
    width_px: int = Field(gt=0, le=MAX_SIDE_PX)
    height_px: int = Field(gt=0, le=MAX_SIDE_PX)
    params: tuple[float, ...]

    def __str__(self) -> str:
        params = ", ".join(f"{value:.6g}" for value in self.params)
        return f"{self.model} ({params}) at {self.width_px}×{self.height_px} px"

    @model_validator(mode="after")
    def _is_a_camera(self) -> "KnownIntrinsics":
        self.camera()
        return self

    def camera(self) -> DistortedCamera:
        """The calibration as a camera; raises ``InvalidInputError`` for a bad model or bad parameters."""
        return DistortedCamera(self.model, self.width_px, self.height_px, self.params)


class FocalPrior(Record):
    """A focal length prior for images whose EXIF has none: in px of an image ``width_px`` wide."""

    width_px: int = Field(gt=0, le=MAX_SIDE_PX)
    focal_length_px: float = Field(gt=0)

    @model_validator(mode="after")
    def _is_plausible(self) -> "FocalPrior":
        least, most = PLAUSIBLE_SHARE
        if not least <= self.focal_length_px / self.width_px <= most:
            raise ValueError(f"focal_length_px must be from {least:g} to {most:g} widths")
        return self

    def at(self, width_px: int) -> float:
        """The focal length in px of an image of this width."""
        return self.focal_length_px * width_px / self.width_px


class GateSettings(Record):
    """The thresholds of the gate (``verification.checks``), each with the measurement that it rests on.

    They were chosen on *fox*, *castle-P19*, *fountain-P11* and *kermit*, and with *bonsai* and *lund* in
    view; ``docs/design/gate.md`` has more. Shares of rotations and directions are weighted by matches.
    """

    min_match_support: float = Field(default=0.90, ge=0, le=1)
    """Minimum share of the verified matches that an accepted model explains.

    Right models of scenes with true poses have 0.92 or more, grossly wrong ones at most 0.80.
    """

    min_doubtful_match_support: float = Field(default=0.85, ge=0, le=1)
    """Match support below which a model is rejected. From here to ``min_match_support`` it is doubtful, or
    rejected when nothing confirms it.

    A right model of *lund*, whose focal length is 25 % off EXIF's, has 0.88.
    """

    min_rotation_support: float = Field(default=0.80, ge=0, le=1)
    """Minimum share of the independent relative rotations that are within 5° of the model's.

    Right models have 0.88 or more, wrong ones at most 0.74.
    """

    min_translation_support: float = Field(default=0.80, ge=0, le=1)
    """Minimum share of the independent translation directions that are within 15° of the model's.

    Right models have 0.858 or more, wrong ones at most 0.745. A short arc with a focal length a third too
    short has 0.215, where matches (0.90) and rotations (0.94) fit. A model with less is doubtful, or rejected
    when nothing confirms it: where all baselines are short, directions are noise.
    """

    max_unsupported_share: float = Field(default=0.1, ge=0, le=1)
    """Share of a model's images up to which unsupported or misscaled ones are left out.

    Above it the model is rejected. Wrong models of *fox* have 11 to 25 unsupported images of 50.
    """

    max_misplaced_share: float = Field(default=MAX_MISPLACED_SHARE, ge=0, le=1)
    """The same for images that are far from their position priors, or see hardly any points."""

    min_shared_images: int = Field(default=4, ge=1)
    """Minimum number of images that two models must share to be compared: three always fit.

    A model also keeps as many when images with few points are left out.
    """

    max_disagreement: float = Field(default=0.05, gt=0)
    """Maximum median distance between the camera centres of two models that agree, in shares of the spread.

    Those of *brighton* and *banana* differ by 0.0006; wrong models of *fox* are off by 0.34 and 0.74.
    """

    max_prior_disagreement: float = Field(default=0.25, gt=0)
    """Maximum median distance between camera centres and position priors, in shares of the track's spread.

    Right models have 0.01 (*brighton*) to 0.073 (*lund*) with GPS.
    """

    confirming_prior_share: float = Field(default=0.1, gt=0)
    """The same for position priors that confirm a doubtful model; chosen with *lund* (0.073) in view."""

    min_prior_support: float = Field(default=0.6, ge=0, le=1)
    """Minimum share of the pairs whose baselines fit position priors that are evidence.

    Of *fox*, 95 % of the right pairs are off by at most 3°, 95 % of the wrong ones by 39° or more.
    """

    doubt_discount: float = Field(default=0.5, gt=0, le=1)
    """Factor on the explained matches of a doubtful model when it is compared with an accepted one."""

    close_support: float = Field(default=0.01, ge=0, le=1)
    """Difference of match support up to which two models that contradict each other are equally supported."""


class GrowthSettings(Record):
    """How images are added to a reconstruction; ``reconstruct`` does not use these."""

    neighbours_in_order: int = Field(default=3, ge=0)
    """Number of images on either side in capture order (sorted names) that a new one is matched with."""

    neighbours_recent: int = Field(default=2, ge=0)
    """Number of images added last, taken nearby by a moving vehicle, that a new one is matched with."""

    neighbours_by_similarity: int = Field(default=10, ge=1)
    """Number of most similar images that a new one is matched with."""

    neighbours_in_space: int = Field(default=8, ge=0)
    """Number of images near to the best matched ones that a new one is matched with after that."""

    min_image_support: float = Field(default=0.75, ge=0, le=1)
    """Minimum share of the verified matches of an image that its pose explains; else it is not registered."""

    adjust_every: float = Field(default=0.1, gt=0)
    """Growth of the number of images or points, as a share, after which global bundle adjustment follows."""

    remap_every: float = Field(default=0.1, gt=0)
    """Minimum growth of the number of images between two re-maps, as a share."""

    max_support_loss: float = Field(default=0.03, gt=0)
    """Loss of match support since the last re-map at which the next one is due."""

    max_unregistered: float = Field(default=0.1, gt=0)
    """Ratio of unregistered images that match registered ones to these, from which on a re-map is due."""


class FeatureSettings(Record):
    """How SIFT features are extracted from an image."""

    max_image_size_px: int = Field(default=1600, ge=64)
    """Long side to which larger images are reduced."""

    upsample_below_px: int = Field(default=1400, ge=0)
    """Long side, after that reduction, below which images are upsampled twofold.

    Upsampling finds small features, which small images need, and takes three quarters of the time.
    """

    max_features: int = Field(default=4096, ge=100)
    """Maximum number of features of an image; the largest are kept."""


class SfmSettings(Record):
    """The settings of ``reconstruct``; the defaults suit photographs of one scene by one camera."""

    features_of_few: FeatureSettings = FeatureSettings()
    """For sets of up to ``exhaustive_up_to`` images, in which every feature counts."""

    features_of_many: FeatureSettings = FeatureSettings(
        max_image_size_px=1200, upsample_below_px=1100, max_features=3072
    )
    """For larger sets, where more images see each point; docs/design/matching.md has the cost in accuracy."""

    camera_model: CameraModel | None = None
    """The camera model to estimate; None: ``SIMPLE_RADIAL``, and for cameras of ten images or more ``RADIAL``
    with its principal point.
    """

    intrinsics: KnownIntrinsics | None = None
    """A calibration that does not change; without one focal length and distortion are estimated."""

    focal_prior: FocalPrior | None = None
    """Initial estimate of the focal length, for images whose EXIF has none."""

    exhaustive_up_to: int = Field(default=20, ge=2)
    """Number of images up to which all pairs are matched.

    Above it, images are matched with their neighbours in order, space and similarity.
    """

    incremental_first_up_to: int = Field(default=100, ge=0)
    """Number of images up to which the incremental mapper runs first; above it, the faster global one does.

    The other one runs unless the gate accepts the first one's model, of nearly all images, by itself.
    """

    gate: GateSettings = GateSettings()
    growth: GrowthSettings = GrowthSettings()
    seed: int = Field(default=0, ge=0)
    threads: int | None = Field(default=None, ge=1)
    """Threads for the native code, all cores if None. With several, results vary in the last digits."""

    @property
    def first_camera_model(self) -> CameraModel:
        """The camera model that the mappers start with."""
        return self.camera_model or "SIMPLE_RADIAL"

    def features(self, images: int) -> FeatureSettings:
        """The settings for the images of a set of ``images``."""
        return self.features_of_few if images <= self.exhaustive_up_to else self.features_of_many
