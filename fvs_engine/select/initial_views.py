"""The initial views of a selection."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.choices import InitialChoice
from fvs_engine.geometry import PinholeCamera
from fvs_engine.plan.distances import view_distances
from fvs_engine.views import AnyView, PinholeView


def initial_views(views: Sequence[AnyView], count: int, choice: InitialChoice, seed: int) -> tuple[str, ...]:
    """The names of ``count`` of ``views``, which are in order of capture, in the order of their visit.

    ``first``: the first of the capture, as a vehicle takes them when it arrives (the paper). ``consecutive``:
    as many in a row, from an index that ``seed`` draws. ``farthest``: spread over position and direction from
    a view that ``seed`` draws; each next is the one whose nearest chosen view is farthest (Gonzalez,
    "Clustering to minimize the maximum intercluster distance", 1985), in the measure of ``view_distances``.
    """
    generator = np.random.default_rng(seed)
    if choice == "farthest":
        poses = [_without_distortion(view) for view in views]
        indices = _spread(view_distances(poses, poses), count, int(generator.integers(len(views))))
    else:
        start = int(generator.integers(len(views) - count + 1)) if choice == "consecutive" else 0
        indices = list(range(start, start + count))
    return tuple(views[index].name for index in indices)


def _spread(distances: np.ndarray, count: int, first: int) -> list[int]:
    chosen = [first]
    while len(chosen) < count:
        separation = distances[chosen].min(axis=0)
        separation[chosen] = -1.0  # ranks below views that coincide with a chosen one
        chosen.append(int(np.argmax(separation)))
    return chosen


def _without_distortion(view: AnyView) -> PinholeView:
    """The view with a camera without distortion; ``view_distances`` uses only its pose."""
    camera = view.camera
    plain = PinholeCamera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    return PinholeView(view.name, plain, view.camera_from_model)
