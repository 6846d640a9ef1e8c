"""Warm starts: a quick model continues from the last full one instead of being trained anew.

A full model depends on its views alone, so a quick one that continues from it depends on the views of both,
and on nothing else. Source of the numbers: ``docs/design/training.md``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.settings import Densification, LearningRates, Level
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView

_ITERATIONS = 14
_ITERATIONS_PER_NEW_VIEW = 6
"""Iterations per new view; every second iteration is on a new view, so that each gets three."""

_RATE = 0.3
"""Factor of the learning rates: with the full rates the model degrades more than it gains."""

_MOST_NEW = 0.5
"""New views per view of the full model beyond which a new model is better."""

_MOST_SHIFT_PX = 2.0
"""Maximum movement of a camera since: the median shift of projected points, in px of training images."""

_POINTS = 2_000
"""Maximum number of points that are projected."""


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Training that continues from a ``full`` model; every second iteration is on a ``new`` view."""

    full: SceneModel
    new: frozenset[str]

    @classmethod
    def of(
        cls,
        full: SceneModel,
        trained: Sequence[PinholeView],
        views: Sequence[TrainingView],
        points: PointCloud,
    ) -> "WarmStart | None":
        """The warm start from a ``full`` model of ``trained`` views for ``views``, which share ``points``.

        None when it should not: a view that it was trained on is gone, whose image may have been deleted;
        too many views are new; or cameras have moved.
        """
        present = {view.name: view for view in views}
        new = frozenset(present) - {view.name for view in trained}
        if len(views) - len(new) < len(trained) or len(new) > _MOST_NEW * len(trained):
            return None
        if any(_shift_px(view, present[view.name], points) > _MOST_SHIFT_PX for view in trained):
            return None
        return cls(full, new)

    @property
    def until_iteration(self) -> int:
        """The iteration at which it ends; it counts on from those of the full model."""
        return self.full.iterations + max(_ITERATIONS, _ITERATIONS_PER_NEW_VIEW * len(self.new))

    def trainer(
        self, views: Sequence[TrainingView], settings: SceneSettings, rasterizer: Rasterizer
    ) -> Trainer:
        """The trainer of the ``views``, on images as large as the largest of other quick models."""
        half_size = Level(until_iteration=self.until_iteration, reduction=2)
        training = settings.training.model_copy(
            update={
                "levels": (half_size,) if settings.quick_at_half_size else (),
                "densification": Densification(last_iteration=0),
                "learning_rates": _slower(settings.training.learning_rates),
            }
        )
        repeats_of_new = max(1, round((len(views) - len(self.new)) / max(1, len(self.new))))
        repeats = [repeats_of_new if view.name in self.new else 1 for view in views]
        trainer = Trainer(views, self.full.gaussians, training, rasterizer, settings.seed, repeats)
        trainer.iteration = self.full.iterations
        return trainer


def _slower(rates: LearningRates) -> LearningRates:
    return LearningRates(**{name: _RATE * rate for name, rate in rates})


def _shift_px(before: PinholeView, now: TrainingView, points: PointCloud) -> float:
    """The median distance between the projections of points into a camera as it was and as it is."""
    if before.camera == now.camera and np.array_equal(
        before.camera_from_model.matrix, now.camera_from_model.matrix
    ):
        return 0.0  # all but a few of them, when one image is added
    xyz = points.xyz[:: 1 + len(points) // _POINTS]
    was = before.camera.project(before.camera_from_model.apply(xyz))
    seen = ((was >= 0) & (was <= [before.camera.width, before.camera.height])).all(axis=1)
    is_now = now.camera.project(now.camera_from_model.apply(xyz[seen]))
    shift_px = np.linalg.norm(is_now - was[seen], axis=1)
    return float(np.median(np.nan_to_num(shift_px, nan=np.inf))) if seen.any() else np.inf
