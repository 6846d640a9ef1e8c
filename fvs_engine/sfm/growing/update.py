"""Result of adding images: the current poses and points, and the changes."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fvs_engine.sfm.growing.two_view_points import TwoViewPoints
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding


@dataclass(frozen=True, eq=False)
class PoseUpdate:
    """The current views and points in the model frame, and the changes from the views that were known before.

    ``views`` are those of the registered images; ``points`` were seen by two of them or more, and
    ``two_view_points``, where they are not among those, by two alone. ``generation`` is the number of the
    last committed model. ``seconds`` is the wall-clock time per stage.
    """

    views: tuple[AnyView, ...]
    points: PointCloud
    generation: int

    registered: tuple[str, ...]
    """Images that have a pose now and had none before, in the order of adding."""

    unregistered: tuple[str, ...]
    """All added images without a pose, in the order of adding."""

    lost: frozenset[str]
    """Images that had a pose and have none now."""

    moved: frozenset[str]
    """Images whose pose or camera changed."""

    warnings: tuple[Finding, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    two_view_points: TwoViewPoints | None = None

    @staticmethod
    def between(
        known: Iterable[AnyView],
        views: Iterable[AnyView],
        points: PointCloud,
        added: Sequence[str],
        generation: int,
    ) -> "PoseUpdate":
        """Compare ``views`` with those ``known`` before; ``added``: all images, in the order of adding."""
        before = {view.name: view for view in known}
        now = {view.name: view for view in views}
        return PoseUpdate(
            views=tuple(now.values()),
            points=points,
            generation=generation,
            registered=tuple(name for name in added if name in now and name not in before),
            unregistered=tuple(name for name in added if name not in now),
            lost=frozenset(before.keys() - now.keys()),
            moved=frozenset(name for name in before.keys() & now.keys() if _differ(before[name], now[name])),
        )


def _differ(first: AnyView, second: AnyView) -> bool:
    return first.camera != second.camera or not np.array_equal(
        first.camera_from_model.matrix, second.camera_from_model.matrix
    )
