"""Distances: how different two views are in position and direction, and how long a path is."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.views import PinholeView

Floats = NDArray[np.floating[Any]]


def view_distances(views: Sequence[PinholeView], others: Sequence[PinholeView]) -> Floats:
    """The difference of every view from every other: [len(views), len(others)], a metric without unit.

        d(a, b)² = |c_a − c_b|² / s² + |v_a − v_b|²

    with camera centres c, unit viewing directions v, and the spread s of the scene: the root mean square
    distance of all centres given, of both lists, from their mean. Two random views then differ by √2 in
    either term, so that neither outweighs the other; rolling a camera around its axis changes nothing. Where
    all centres coincide, only directions count.
    """
    centres, directions = _poses([*views, *others])
    spread = float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(centres) else 0
    points = np.concatenate([centres / spread if spread > 0 else 0 * centres, directions], axis=1)
    first, second = points[: len(views)], points[len(views) :]
    return np.asarray(np.linalg.norm(first[:, None] - second[None], axis=-1))


def path_length(centres: ArrayLike) -> float:
    """The length of the path through camera centres [N, 3], in their order; 0 for one."""
    points = np.asarray(centres, dtype=np.float64).reshape(-1, 3)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _poses(views: Sequence[PinholeView]) -> tuple[Floats, Floats]:
    """Centres and viewing directions, [n, 3] each, in the model frame."""
    centres = np.array([view.centre for view in views]).reshape(-1, 3)
    directions = np.array([view.camera_from_model.rotation[2] for view in views]).reshape(-1, 3)
    return centres, directions
