"""Settings of a growing scene."""

from typing import Literal

from pydantic import Field

from fvs_engine.records import Record
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.splat.settings import Densification, TrainingSettings

_NEVER = 1_000_000

GROWING_TRAINING = TrainingSettings(
    iterations=30_000,
    sh_degree=0,
    max_gaussians=100_000,
    densification=Densification(
        first_iteration=100,
        last_iteration=_NEVER,
        interval=100,
        opacity_reset_interval=_NEVER,
    ),
)
"""Training of a scene to which views may be added at any time.

The positions' learning rate decays over the paper's 30,000 iterations, independent of the present views: with
a shorter schedule new Gaussians would hardly move. Densification goes on as long as views are added (for its
schedule see ``SceneSettings.schedule``). Opacities are not reset: the model is used after every addition.

Measured on *bonsai*, known poses, 10 views and 10 more at 256 × 171 px, mean PSNR of every 8th view:
20.7 dB; with a schedule of 5,000 iterations 20.4 dB (both with at most 25,000 Gaussians; with 60,000 it is
21.0 dB, with 300,000 21.1 dB).
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
    """How a scene gets its poses and how long it is trained; frozen, and stored with the scene.

    ``poses``: ``sfm`` estimates them from the visited images, ``known`` takes the dataset's. With
    ``sfm``, the dataset's poses are pose priors with ``prior_noise``; None: they are not used. Training
    lasts ``initial_iterations``, and ``iterations_per_view`` more for every view that is registered after the
    first ones (the paper's Algorithm 1: 1,000 and 100). ``long_side_px`` is the size of the training
    images; with ``coarse_to_fine`` a new model begins on reduced ones (ADR 24).
    """

    poses: Literal["sfm", "known"] = "sfm"
    prior_noise: PriorNoise | None = PriorNoise()
    long_side_px: int = Field(default=800, ge=32)
    initial_iterations: int = Field(default=1_000, ge=0)
    iterations_per_view: int = Field(default=100, ge=0)
    coarse_to_fine: bool = False
    training: TrainingSettings = GROWING_TRAINING
    sfm: SfmSettings = SfmSettings()
    seed: int = Field(default=0, ge=0)

    @property
    def schedule(self) -> TrainingSettings:
        """``training``, but densification falls half-way between the iterations at which training may end.

        Those are the initial ones and every ``iterations_per_view`` from there. Renders are
        worse for some iterations after Gaussians were split, and must not be evaluated then. The interval is
        the multiple of ``iterations_per_view`` nearest to that of ``training``.
        """
        step, rules = self.iterations_per_view, self.training.densification
        if step == 0:
            return self.training
        interval = step * max(1, round(rules.interval / step))
        phase = (self.initial_iterations + step // 2) % interval
        densification = rules.model_copy(update={"interval": interval, "phase": phase})
        return self.training.model_copy(update={"densification": densification})
