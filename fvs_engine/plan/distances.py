"""Distances: how different two views are in position and direction, and how long a path is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.views import AnyView

Floats = NDArray[np.float64]


def view_distances(views: Sequence[AnyView], others: Sequence[AnyView]) -> Floats:
    """The difference of every view from every other: [len(views), len(others)], a metric without unit.

        d(a, b)² = |c_a − c_b|² / s² + |v_a − v_b|²

    with camera centres c, unit viewing directions v, and the spread s of the scene: the root mean square
    distance of all centres given, of both lists, from their mean. Two random views then differ by √2 in
    either term, so that neither outweighs the other; rolling a camera around its axis changes nothing. Where
    all centres coincide, only directions count.
    """
    points = view_points([*views, *others], spread([*views, *others]))
    return distances_between(points[: len(views)], points[len(views) :])


def view_points(views: Sequence[AnyView], spread: float) -> Floats:
    """Points [len(views), 6] whose Euclidean distances are ``view_distances`` for this ``spread``."""
    centres = _centres(views)
    directions = np.array([view.camera_from_model.rotation[2] for view in views]).reshape(-1, 3)
    return np.concatenate([centres / spread if spread > 0 else 0 * centres, directions], axis=1)


def distances_between(points: Floats, others: Floats) -> Floats:
    """Euclidean distances [len(points), len(others)]."""
    # Differences, not products, which would leave 1e-8 between equal points.
    squares = np.zeros((len(points), len(others)))
    for a, b in zip(points.T, others.T, strict=True):
        squares += (a[:, None] - b[None]) ** 2
    return np.asarray(np.sqrt(squares))


def spread(views: Sequence[AnyView]) -> float:
    """The root mean square distance of camera centres from their mean; 0 without views."""
    centres = _centres(views)
    return centre_spread(centres) if len(centres) else 0.0


def path_length(centres: ArrayLike) -> float:
    """The length of the path through camera centres [N, 3], in their order; 0 for one."""
    points = np.asarray(centres, dtype=np.float64).reshape(-1, 3)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _centres(views: Sequence[AnyView]) -> Floats:
    """In the model frame, [n, 3]."""
    return np.array([view.centre for view in views]).reshape(-1, 3)


def even_sample(count: int, most: int) -> NDArray[np.int64]:
    """Sorted indices of a uniform random sample, the same at every call: at most ``most`` of ``count``."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, max(1, most), replace=False))
