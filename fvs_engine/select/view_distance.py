"""How different two views are: where they stand and where they look, in one number."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvs_engine.score import Candidate

Floats = NDArray[np.floating[Any]]


def view_distances(views: Sequence[Candidate], others: Sequence[Candidate]) -> Floats:
    """How different every view is from every other: [len(views), len(others)], a metric without unit.

        d(a, b)² = |c_a − c_b|² / s² + |v_a − v_b|²

    with camera centres c, unit viewing directions v, and the spread s of the scene: the root mean square
    distance of all centres given, of both lists, from their mean. Two views at random then differ by √2 in
    either term, so that neither outweighs the other; rolling a camera around its axis changes nothing.
    Where all centres coincide, only directions count.
    """
    centres, directions = _poses([*views, *others])
    spread = float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(centres) else 0
    points = np.concatenate([centres / spread if spread > 0 else 0 * centres, directions], axis=1)
    first, second = points[: len(views)], points[len(views) :]
    return np.asarray(np.linalg.norm(first[:, None] - second[None], axis=-1))


def centre(view: Candidate) -> Floats:
    """The camera's centre [3] in the model frame."""
    return view.camera_from_model.inverse().translation


def _poses(views: Sequence[Candidate]) -> tuple[Floats, Floats]:
    """Centres and viewing directions, [n, 3] each, in the model frame."""
    centres = np.array([centre(view) for view in views]).reshape(-1, 3)
    directions = np.array([view.camera_from_model.rotation[2] for view in views]).reshape(-1, 3)
    return centres, directions
