"""Points that three images share, against a model's poses.

Two cameras see the same epipolar lines whatever the distance between them is. So no pair contradicts a model
in which part of a row of cameras is shifted along it. A point that three images see does: each two of them
give its depth, and the depths agree only where the distances between the cameras have the right ratio.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.verification.pair_check import (
    EXPLAINED,
    MAX_ERROR_PX,
    MIN_PAIR_MATCHES,
    fitting,
    focal_px,
    normalised,
)

Array = NDArray[np.float64]

MIN_PARALLAX_DEG = 1.0
"""Smallest angle between two of the three rays: below, the point's depth is hardly known."""

_MOST_PER_PAIR = 4
"""Third images that are examined with a pair, those that share the most matches with it."""


@dataclass(frozen=True)
class TripleCheck:
    """Points that ``images`` (three ids) share, matched in all three pairs, each of which fits the poses.

    ``supported`` of them fit all three poses at once.
    """

    images: tuple[int, int, int]
    points: int
    supported: int


def check_triples(
    model: pycolmap.Reconstruction, pairs: Sequence[VerifiedPair], keypoints: Mapping[int, Array]
) -> list[TripleCheck]:
    """Compare the points that three images share with the model.

    ``keypoints`` maps image ids to positions [K, 2] in px of the full-size images.
    """
    views = _views(model, keypoints)
    matches = _Matches(model, pairs, keypoints)
    found = []
    for images in matches.triples():
        points = matches.shared(images)
        rays = np.stack([views[i].rays[column] for i, column in zip(images, points, strict=True)], axis=1)
        rays = rays[_parallax_deg(rays) >= MIN_PARALLAX_DEG]
        if len(rays) > 0:
            fits = _meet(rays, [views[i] for i in images])
            found.append(TripleCheck(images, len(rays), int(fits.sum())))
    return found


def inconsistent_images(model: pycolmap.Reconstruction, checks: Sequence[TripleCheck]) -> frozenset[str]:
    """Names of groups of images that do not fit the rest by the points that three images share.

    A group that is consistent in itself is on the smaller side of a cut across which most points fail.
    """
    names = {i: image.name for i, image in model.images.items() if image.has_pose}
    if not checks:
        return frozenset()
    ids = sorted(names)
    index = {image_id: k for k, image_id in enumerate(ids)}
    triples = np.array([[index[i] for i in check.images] for check in checks])
    points, supported = (
        np.array([getattr(check, part) for check in checks]) for part in ("points", "supported")
    )
    explained = (supported >= MIN_PAIR_MATCHES) & (supported >= EXPLAINED * points)

    def contradicted(side: NDArray[np.bool_]) -> bool:
        """Whether most points that are seen from both sides of a cut fail, without what was found before."""
        across = side[triples].any(axis=1) & ~side[triples].all(axis=1) & ~found[triples].any(axis=1)
        seen, fit = points[across].sum(), supported[across].sum()
        return bool(seen >= MIN_PAIR_MATCHES and fit < EXPLAINED * seen)

    graph = _graph(triples[explained], supported[explained], len(ids))
    group = connected_components(graph, directed=False)[1]
    main = np.bincount(group).argmax()
    found = np.zeros(len(ids), dtype=bool)
    for number in set(group.tolist()) - {int(main)}:
        if contradicted(group == number):
            found |= group == number
    # The spanning tree of the triples of most points: an edge of it is the strongest link across its cut.
    tree = minimum_spanning_tree(graph).tocoo()
    for k in np.flatnonzero(group[tree.row] == main):
        edges = np.arange(tree.nnz) != k
        cut = coo_array((tree.data[edges], (tree.row[edges], tree.col[edges])), shape=tree.shape)
        side = connected_components(cut, directed=False)[1]
        here, there = side == side[tree.row[k]], side == side[tree.col[k]]
        smaller = here if here.sum() < there.sum() else there
        if contradicted(smaller):
            found |= smaller
    return frozenset(names[ids[k]] for k in np.flatnonzero(found))


@dataclass(frozen=True, eq=False)
class _View:
    """A posed image: its centre [3], the unit rays [K, 3] of its key points in the model frame, the error."""

    centre: Array
    rays: Array
    max_error_rad: float


def _views(model: pycolmap.Reconstruction, keypoints: Mapping[int, Array]) -> dict[int, _View]:
    found = {}
    for i, positions in normalised(model, keypoints).items():
        image = model.images[i]
        rays = np.c_[positions, np.ones(len(positions))] @ image.cam_from_world().rotation.matrix()
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        error_rad = MAX_ERROR_PX / focal_px(image)
        found[i] = _View(np.asarray(image.projection_center()), rays, error_rad)
    return found


class _Matches:
    """The matches that fit the poses of their pair: key point of one image → of the other, or −1."""

    def __init__(
        self,
        model: pycolmap.Reconstruction,
        pairs: Sequence[VerifiedPair],
        keypoints: Mapping[int, Array],
    ) -> None:
        positions = normalised(model, keypoints)
        self._to: dict[int, dict[int, NDArray[np.int64]]] = {}
        self._counts: dict[tuple[int, int], int] = {}
        for pair in pairs:
            i, j = pair.first, pair.second
            if i in positions and j in positions:
                kept = pair.matches[fitting(pair, model.images[i], model.images[j], positions)]
                self._add(i, j, kept[:, 0], kept[:, 1], len(positions[i]))
                self._add(j, i, kept[:, 1], kept[:, 0], len(positions[j]))
                self._counts[i, j] = self._counts[j, i] = len(kept)

    def triples(self) -> list[tuple[int, int, int]]:
        """For each pair the images that are matched the most with both."""
        found: set[tuple[int, int, int]] = set()
        for i, j in self._counts:
            common = self._to[i].keys() & self._to[j].keys()
            best = sorted(common, key=lambda k: (-min(self._counts[i, k], self._counts[j, k]), k))
            for k in best[:_MOST_PER_PAIR]:
                a, b, c = sorted((i, j, k))
                found.add((a, b, c))
        return sorted(found)

    def shared(self, images: tuple[int, int, int]) -> tuple[NDArray[np.int64], ...]:
        """The key points in each of three images of the points that all three pairs match."""
        i, j, k = images
        first = np.flatnonzero((self._to[i][j] >= 0) & (self._to[i][k] >= 0))
        second, third = self._to[i][j][first], self._to[i][k][first]
        closed = self._to[j][k][second] == third
        return first[closed], second[closed], third[closed]

    def _add(self, i: int, j: int, at: NDArray[np.uint32], other: NDArray[np.uint32], count: int) -> None:
        matched = np.full(count, -1, dtype=np.int64)
        matched[at] = other
        self._to.setdefault(i, {})[j] = matched


def _parallax_deg(rays: Array) -> Array:
    """The smallest angle [P] between two of the three rays [P, 3, 3] to each point."""
    cosines = np.stack([(rays[:, a] * rays[:, b]).sum(axis=1) for a, b in ((0, 1), (0, 2), (1, 2))])
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).min(axis=0))


def _meet(rays: Array, views: Sequence[_View]) -> NDArray[np.bool_]:
    """Which points [P] the three rays [P, 3, 3] see in front of them, within the error of a match."""
    centres = np.stack([view.centre for view in views])
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    nearest = np.linalg.solve(across.sum(axis=1), np.einsum("pvij,vj->pi", across, centres)[..., None])
    offsets = nearest[:, None, :, 0] - centres
    depths = (offsets * rays).sum(axis=2)
    asides = np.linalg.norm(offsets - depths[..., None] * rays, axis=2)
    within = np.arctan2(asides, depths) <= np.array([view.max_error_rad for view in views])
    return np.asarray((within & (depths > 0)).all(axis=1))


def _graph(triples: NDArray[np.int64], supported: NDArray[np.int64], images: int) -> coo_array:
    """The pairs of images in explained triples, the more points the shorter the edge."""
    ends = np.concatenate([triples[:, [0, 1]], triples[:, [0, 2]], triples[:, [1, 2]]])
    weights = np.zeros((images, images))
    np.add.at(weights, (ends[:, 0], ends[:, 1]), np.tile(supported, 3))
    rows, columns = np.nonzero(weights)
    return coo_array((1.0 / weights[rows, columns], (rows, columns)), shape=(images, images))
