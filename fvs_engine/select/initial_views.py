"""The initial views of a selection."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.choices import InitialChoice
from fvs_engine.plan.distances import spread, view_distances, view_points
from fvs_engine.plan.kriging import TargetVariance
from fvs_engine.plan.planner import plan_views
from fvs_engine.views import AnyView


def initial_views(
    views: Sequence[AnyView], count: int, choice: InitialChoice, seed: int, budget: int | None = None
) -> tuple[str, ...]:
    """The names of ``count`` of ``views``, which are in order of capture, in the order of their visit.

    ``first``: the first of the capture, as a vehicle takes them when it arrives (the paper). ``consecutive``:
    as many in a row, from an index that ``seed`` draws. ``farthest``: spread over position and direction from
    a view that ``seed`` draws; each next is the one whose nearest chosen view is farthest (Gonzalez,
    "Clustering to minimize the maximum intercluster distance", 1985), in the measure of ``view_distances``.
    ``planned``: of the ``budget`` views (by default as many) that together leave the least mean kriging
    variance over all (``plan_views``) those that gain most.
    """
    generator = np.random.default_rng(seed)
    if choice == "planned":
        indices = _planned(view_points(views, spread(views)), max(count, budget or 0))[:count]
    elif choice == "farthest":
        indices = _spread(view_distances(views, views), count, int(generator.integers(len(views))))
    else:
        start = int(generator.integers(len(views) - count + 1)) if choice == "consecutive" else 0
        indices = list(range(start, start + count))
    return tuple(views[index].name for index in indices)


def _planned(points: np.ndarray, budget: int) -> list[int]:
    """Indices of ``budget`` planned views, the one that gains most first."""
    nothing_visited = points[:0]
    variance = TargetVariance(points, points, nothing_visited)
    return list(plan_views(variance, budget, lambda _: np.ones(len(points), dtype=bool)).chosen)


def _spread(distances: np.ndarray, count: int, first: int) -> list[int]:
    chosen = [first]
    while len(chosen) < count:
        separation = distances[chosen].min(axis=0)
        separation[chosen] = -1.0  # ranks below views that coincide with a chosen one
        chosen.append(int(np.argmax(separation)))
    return chosen
