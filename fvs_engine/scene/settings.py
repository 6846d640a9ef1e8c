"""Settings of a scene."""

from typing import Literal

from pydantic import Field

from fvs_engine.records import Record
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.splat.settings import (
    Densification,
    LearningRates,
    TrainingSettings,
    coarse_to_fine,
    coarse_to_fine_of_small_images,
)

ModelQuality = Literal["quick", "full"]
"""The two models of a scene: ``quick`` ranks soon after new images, ``full`` is better and takes longer."""

QUICK_SHARE = 0.2
"""Iterations of a quick model as a share of those of the full model (docs/design/training.md)."""

LARGE_PX = 800
"""Long side of images from which on few iterations are at full size: there they are expensive."""

_MORE_AT_HALF_SIZE = 1.25
"""Factor of the iterations of a quick model at half size at most, where they are cheaper."""

SCENE_TRAINING = TrainingSettings(
    iterations=30_000,
    sh_degree=0,
    max_gaussians=100_000,
    learning_rates=LearningRates().times(2),
    densification=Densification(first_iteration=100, interval=100, opacity_reset_interval=1_000_000),
)
"""Training of a scene's models, which are short: ``SceneSettings.training_of`` completes it.

The positions' learning rate decays over the paper's 30,000 iterations, however short a run is: if it decays
over the run, models of 20 views are 0.6 to 1 dB worse. The other rates are twice the paper's
(docs/design/training.md). Opacities are not reset: a short run gives them no time to recover.
"""


class PriorNoise(Record):
    """Standard deviations of the noise with which a dataset's poses become pose priors.

    ``position_share`` is that of each coordinate, in shares of the spread of the dataset's camera centres;
    ``orientation_deg`` that of the angle about each axis.
    """

    position_share: float = Field(default=0.02, ge=0, le=1)
    orientation_deg: float = Field(default=5.0, ge=0, le=180)


def prior_noise(used: bool, position_percent: float, orientation_deg: float) -> PriorNoise | None:
    """The noise of a request; None when the dataset's poses are not ``used`` as priors."""
    if not used:
        return None
    return PriorNoise(position_share=position_percent / 100.0, orientation_deg=orientation_deg)


class SceneSettings(Record):
    """How a scene gets its poses and how its models are trained; frozen, and stored with the scene.

    ``poses``: ``sfm`` estimates them from the visited images, ``known`` takes the dataset's. With
    ``sfm``, the dataset's poses are pose priors with ``prior_noise``; None: they are not used.
    ``long_side_px`` is the size of the training images.

    A full model of n views is trained for n × ``iterations_per_view`` iterations, but at least for
    ``initial_iterations`` (the paper's Algorithm 1: 1,000 for 10 views, 100 more for each further one); a
    quick model for the share ``quick_share`` of that. Both go from coarse to fine (``coarse_to_fine``): of
    images of 800 px or more a quick one only to half of their size, with a quarter more iterations; a full
    one of many smaller images has half of its iterations at full size.

    ``warm_starts``: a quick model continues from the last full one where that is better (``WarmStart``). The
    models then depend on which full models were trained before.
    """

    poses: Literal["sfm", "known"] = "sfm"
    prior_noise: PriorNoise | None = PriorNoise()
    long_side_px: int = Field(default=800, ge=32)
    initial_iterations: int = Field(default=1_000, ge=1)
    iterations_per_view: int = Field(default=100, ge=0)
    quick_share: float = Field(default=QUICK_SHARE, gt=0, le=1)
    warm_starts: bool = False
    training: TrainingSettings = SCENE_TRAINING
    sfm: SfmSettings = SfmSettings()
    seed: int = Field(default=0, ge=0)

    def iterations_of(self, quality: ModelQuality, views: int) -> int:
        """The iterations of a model of ``views`` views."""
        full = max(self.initial_iterations, self.iterations_per_view * views)
        if quality == "full":
            return full
        share = self.quick_share * (_MORE_AT_HALF_SIZE if self.quick_at_half_size else 1.0)
        return max(1, round(share * full))

    def training_of(self, quality: ModelQuality, iterations: int) -> TrainingSettings:
        """``training`` for a run of ``iterations``: its levels, and no densification at the largest size.

        Renders are worse for some iterations after Gaussians were split.
        """
        if quality == "full" and self.long_side_px < LARGE_PX:
            levels = coarse_to_fine_of_small_images(iterations, self.initial_iterations)
        else:
            to_half_size = quality == "quick" and self.quick_at_half_size
            levels = coarse_to_fine(iterations, to_half_size=to_half_size)
        rules = self.training.densification
        reduced = [level.until_iteration for level in levels if level.until_iteration < iterations]
        last = min(rules.last_iteration, reduced[-1] if reduced else 0)
        densification = rules.model_copy(update={"last_iteration": last})
        return self.training.model_copy(update={"levels": levels, "densification": densification})

    @property
    def quick_at_half_size(self) -> bool:
        """Whether quick models are trained on images of half the size at most."""
        return self.long_side_px >= LARGE_PX
