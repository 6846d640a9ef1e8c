"""The input of a plan: the poses that the model must serve, and the views that may be visited."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import spread, view_points
from fvs_engine.plan.familiarity import Familiarity, Observations
from fvs_engine.plan.kriging import NOISE, TargetVariance, noise_of, variances
from fvs_engine.plan.planner import Mask
from fvs_engine.views import AnyView, PinholeView

Array = NDArray[np.float64]

_POSE_DIGITS = 3
"""Views have one pose where their points (``view_points``, by the spread of the visited ones) are the same,
rounded to so many digits: within 0.1 % of the spread and 0.06°."""


class Targets:
    """Targets and the views that may be visited ``later``, given the ``visited`` ones.

    All are in the model frame. Without targets the model must serve all views, visited and later ones. The
    scale of distances is that of visited and later views: few targets, or ones side by side, have none.
    ``observations`` are the sparse points where poses are estimated, so that a visited view must be
    registered to be of use (None: poses are known). ``taken`` views will be visited by others: they count
    as visited, and are no targets. A masked visited view counts by the share of its image that does. Raises
    ``Cancelled``.
    """

    def __init__(
        self,
        visited: Sequence[AnyView],
        later: Sequence[PinholeView],
        targets: Sequence[AnyView] = (),
        observations: Observations | None = None,
        *,
        taken: Sequence[AnyView] = (),
        monitor: Monitor | None = None,
    ) -> None:
        served = targets or (*visited, *later)
        self.names = tuple(view.name for view in served)
        """Names of the targets."""
        self.later = tuple(later)
        self.index = {view.name: index for index, view in enumerate(later)}
        self.spread = spread((*visited, *later)) or spread(served)
        # Of later ones a single one far away would make all others appear the same.
        self._spread_visited = spread(visited) or self.spread
        self._visited = view_points((*visited, *taken), self.spread)
        self._noise = noise_of((*visited, *taken))
        self._later = view_points(later, self.spread)
        self.points = view_points(served, self.spread)
        """Points of the targets, [T, 6]."""
        self.variance = TargetVariance(self.points, self._later, self._visited, noise=self._noise)
        seen = observations is not None and len(observations.points) > 0
        self.familiarity = (
            Familiarity(observations, later, monitor) if observations is not None and seen else None
        )
        """Familiarity of the later views; None where poses are known."""

    @property
    def centres(self) -> Array:
        """Camera centres of the later views, [n, 3]."""
        return np.array([view.centre for view in self.later]).reshape(-1, 3)

    @property
    def one_of_pose(self) -> Mask:
        """Mask [n] with one later view of each pose, ignoring roll: the likeliest registered or first."""
        mask = np.zeros(len(self.later), dtype=bool)
        rounded = np.round(view_points(self.later, self._spread_visited), _POSE_DIGITS) + 0.0  # not -0.0
        order = np.argsort(-self.chances, kind="stable")
        mask[order[np.unique(rounded[order], axis=0, return_index=True)[1]]] = True
        return mask

    def admissible(self, plan: Sequence[int]) -> Mask:
        """Which later views [n] can be registered beside planned ones: all of them where poses are known."""
        if self.familiarity is None:
            return np.ones(len(self.later), dtype=bool)
        return self.familiarity.enough(plan)

    @property
    def chances(self) -> Array:
        """The probability of being registered now, of every later view [n]; 1 where poses are known."""
        return np.ones(len(self.later)) if self.familiarity is None else self.familiarity.probability()

    @property
    def likely(self) -> Mask | None:
        """Which later views [n] are likely to be registered now; None where poses are known."""
        return None if self.familiarity is None else self.familiarity.likely

    def registrable(self, candidates: Sequence[PinholeView]) -> tuple[PinholeView, ...]:
        """Those of ``candidates`` that are likely to be registered; the likeliest where none is."""
        if self.familiarity is None:
            return tuple(candidates)
        mask, counts = self.admissible([]), self.familiarity.counts
        likely = tuple(view for view in candidates if mask[self.index[view.name]])
        return likely or (max(candidates, key=lambda view: float(counts[self.index[view.name]])),)

    def own_variances(self) -> Array:
        """The kriging variance of every later view [n]."""
        return variances(self._later, self._visited, self._noise)

    def variances_after(self, plan: Sequence[int]) -> Array:
        """The kriging variance of every target [T] once the views of ``plan`` were visited."""
        visited = np.concatenate([self._visited, self._later[list(plan)]])
        return variances(self.points, visited, np.append(self._noise, np.full(len(plan), NOISE)))
