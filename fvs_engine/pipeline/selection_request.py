"""Settings of a selection as requested, and the loop settings that follow for a dataset."""

from pydantic import ValidationError

from fvs_engine.choices import HoldOut, InitialChoice, Poses, Quality
from fvs_engine.errors import InvalidInputError
from fvs_engine.hold_out import hold_out
from fvs_engine.pipeline.manifest import DEFAULT_LONG_SIDE_PX
from fvs_engine.records import Record, first_error
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings, prior_noise
from fvs_engine.select.loop_settings import LoopSettings
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.splat.settings import PRESETS, TrainingSettings
from fvs_schema.words import Method

DEFAULT_BUDGET = 100
"""The paper's budget."""


class SelectionRequest(Record):
    """Settings of a selection; those of the loop are explained in ``LoopSettings``.

    None takes a default: for ``budget`` the paper's, or all views where there are fewer; for
    ``long_side_px`` and ``max_gaussians`` those of the ``quality``. Structure from motion uses one thread by
    default: only then are the poses, and with them all choices, the same in every run.
    """

    method: Method = "median-frequency"
    budget: int | None = None
    initial: int = 10
    initial_choice: InitialChoice = "first"
    radius: float | None = None
    nearest: int | None = None
    test_every: int = 8
    hold_out: HoldOut = "every"
    poses: Poses = "sfm"
    priors: bool = True
    position_noise_percent: float = 2.0
    orientation_noise_deg: float = 5.0
    quality: Quality = "coarse"
    initial_iterations: int = 1_000
    iterations_per_view: int = 100
    long_side_px: int | None = None
    max_gaussians: int | None = None
    time_limit_s: float | None = None
    stop_at_db: float | None = None
    stop_at_gain_db: float | None = None
    max_travel: float | None = None
    vehicles: int = 1
    registrable: bool = True
    seed: int = 0
    threads: int | None = None

    def scene_settings(self) -> SceneSettings:
        """The coarse or fine preset on the paper's schedule."""
        preset = PRESETS[self.quality]
        training = SCENE_TRAINING.model_dump() | {
            "sh_degree": preset.sh_degree,
            "max_gaussians": self.max_gaussians or preset.max_gaussians,
        }
        return SceneSettings(
            poses=self.poses,
            prior_noise=prior_noise(self.priors, self.position_noise_percent, self.orientation_noise_deg),
            long_side_px=self.long_side_px or DEFAULT_LONG_SIDE_PX[self.quality],
            initial_iterations=self.initial_iterations,
            iterations_per_view=self.iterations_per_view,
            training=TrainingSettings.model_validate(training),
            sfm=SfmSettings(seed=self.seed, threads=self.threads or 1),
            seed=self.seed,
        )

    def loop_settings(self, dataset: Dataset) -> LoopSettings:
        """The loop's settings for ``dataset``.

        Raises ``InvalidInputError`` for values that contradict each other, the dataset, or are out of range.
        """
        pool, _ = hold_out(dataset.names, self.test_every, self.hold_out)
        if len(pool) < self.initial:
            raise InvalidInputError(
                f"{dataset.name} has only {len(pool)} views to visit, and the selection begins with "
                f"{self.initial}.",
                hint="Begin with fewer (--initial), or hold out fewer for testing (--test-every).",
            )
        try:
            return LoopSettings(
                scene=self.scene_settings(),
                budget=self.budget or max(self.initial, min(DEFAULT_BUDGET, len(pool))),
                **self.model_dump(include=LoopSettings.model_fields.keys() - {"budget"}),
            )
        except ValidationError as error:
            raise InvalidInputError(f"{first_error(error, 'These settings cannot be used')}.") from error
