"""What can be chosen about structure from motion."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from fvs_engine.geometry.cameras import DistortedCamera

MapperName = Literal["incremental", "global"]
"""COLMAP's two ways from two-view geometries to a model."""


class KnownIntrinsics(BaseModel):
    """A calibration of all images (of its shape, at any size): COLMAP's model name and parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    model: str
    width_px: int = Field(gt=0)
    height_px: int = Field(gt=0)
    params: tuple[float, ...]

    @model_validator(mode="after")
    def _is_a_camera(self) -> "KnownIntrinsics":
        self.camera()
        return self

    def camera(self) -> DistortedCamera:
        """The calibration as a camera; raises ``InvalidInputError`` when it is none."""
        return DistortedCamera(self.model, self.width_px, self.height_px, self.params)


class GateSettings(BaseModel):
    """What a model must show before it is believed; see ``docs/adr/0002-gating-reconstructions.md``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    min_match_support: float = Field(default=0.90, ge=0, le=1)
    """Share of the verified matches that the model's poses must explain."""

    min_doubtful_match_support: float = Field(default=0.85, ge=0, le=1)
    """Between this and ``min_match_support`` a model is used, with a warning, if two mappers agree on it."""

    min_rotation_support: float = Field(default=0.80, ge=0, le=1)
    """Share of the independent relative rotations, weighted by matches, that the model must keep."""

    max_disagreement: float = Field(default=0.05, gt=0)
    """Median distance between two mappers' camera centres, in shares of the scene's spread."""

    max_prior_disagreement: float = Field(default=0.25, gt=0)
    """Median distance between camera centres and GPS, in shares of the GPS track's spread."""


class SfmSettings(BaseModel):
    """The settings of ``reconstruct``; the defaults suit photographs of one scene by one camera."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    max_image_size_px: int = Field(default=1600, ge=64)
    """Features are sought in images reduced to this long side."""

    max_features: int = Field(default=4096, ge=100)
    """Features kept per image, the largest first."""

    camera_model: Literal["SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"] = "SIMPLE_RADIAL"
    intrinsics: KnownIntrinsics | None = None
    """A calibration to be kept as it is; without one focal length and distortion are estimated."""

    exhaustive_up_to: int = Field(default=60, ge=2)
    """Up to so many images every pair is matched; above, neighbours in order, in space and in looks."""

    both_mappers_up_to: int = Field(default=100, ge=0)
    """Up to so many images both mappers run, to see whether they agree; above, the second only in doubt."""

    gate: GateSettings = GateSettings()
    seed: int = Field(default=0, ge=0)
    threads: int | None = Field(default=None, ge=1)
    """Threads for the native code, all cores if None. With several the last digits vary between runs."""
