"""Check of the distances between a model's cameras by the depths of features that three of them see.

The matches of two images say nothing about the distance between them: if the cameras form a row, a part of it
may be shifted along the row, and every pair still fits. A feature of one image that two others match has two
depths, one from each pair. Their ratio is that of the two distances: a right model makes them equal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.verification.pair_check import fitting, normalised
from fvs_engine.sfm.verification.thresholds import DEPTHS

Array = NDArray[np.float64]

_Pair = frozenset[int]


@dataclass(frozen=True)
class DepthRatio:
    """The features of image ``middle`` that match ``first`` and ``second`` (image ids).

    ``log_ratio`` is the median logarithm of their depth by the first over that by the second, ``scatter`` the
    robust standard deviation.
    """

    middle: int
    first: int
    second: int
    log_ratio: float
    scatter: float

    @property
    def images(self) -> frozenset[int]:
        """The three images."""
        return frozenset((self.middle, self.first, self.second))

    @property
    def pairs(self) -> tuple[_Pair, _Pair]:
        """The two pairs that are compared."""
        return frozenset((self.middle, self.first)), frozenset((self.middle, self.second))


@dataclass(frozen=True)
class Scale:
    """Names of the images of a model whose distances to the rest contradict the depths, or lack them."""

    contradicted: frozenset[str]
    """Most depths that are compared with the rest's contradict their distance."""

    open: frozenset[str]
    """No chain of features seen in three images connects them with the rest: any distance would fit."""

    @staticmethod
    def of(
        names: Mapping[int, str], ratios: Sequence[DepthRatio], max_error: float = DEPTHS.max_log_error
    ) -> "Scale":
        """Evaluate ``ratios`` for the images ``names`` (by id) of a model; two have no distance to compare.

        Pairs whose depths agree have one scale. The largest group of such pairs is the rest.
        """
        if len(names) <= 2:
            return Scale(frozenset(), frozenset())
        informative = [ratio for ratio in ratios if ratio.scatter <= DEPTHS.max_scatter]
        agrees = [abs(ratio.log_ratio) <= max_error for ratio in informative]
        groups = _groups([ratio.pairs for ratio in _sound(informative, agrees)])
        main = groups[0] if groups else frozenset[int]()
        left, contradicted = set(names) - main, set[int]()
        for group in [*groups[1:], *(frozenset((i,)) for i in sorted(left))]:
            apart = group & left
            left -= apart
            across = [
                agree
                for ratio, agree in zip(informative, agrees, strict=True)
                if ratio.images & apart and ratio.images & main and ratio.images <= apart | main
            ]
            if sum(across) < len(across) / 2:
                contradicted |= apart
        unknown = names.keys() - _joined(_groups([ratio.pairs for ratio in ratios])) - contradicted
        return Scale(frozenset(names[i] for i in contradicted), frozenset(names[i] for i in unknown))


def _sound(informative: Sequence[DepthRatio], agrees: Sequence[bool]) -> list[DepthRatio]:
    """The comparisons that agree, of sound pairs.

    A pair of whose comparisons two thirds disagree connects nothing: a long one hides a small shift.
    """
    balance: dict[_Pair, int] = {}
    for ratio, agree in zip(informative, agrees, strict=True):
        for pair in ratio.pairs:
            balance[pair] = balance.get(pair, 0) + (2 if agree else -1)
    return [
        ratio
        for ratio, agree in zip(informative, agrees, strict=True)
        if agree and all(balance[pair] > 0 for pair in ratio.pairs)
    ]


def _groups(edges: Sequence[tuple[_Pair, _Pair]]) -> list[frozenset[int]]:
    """The images of each group of pairs that comparisons join, the largest group first."""
    if not edges:
        return []
    number = {pair: k for k, pair in enumerate(dict.fromkeys(pair for edge in edges for pair in edge))}
    rows, columns = np.array([[number[pair] for pair in edge] for edge in edges]).T
    graph = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(number), len(number)))
    component = connected_components(graph, directed=False)[1]
    images: dict[int, frozenset[int]] = {}
    for pair, k in number.items():
        group = int(component[k])
        images[group] = images.get(group, frozenset()) | pair
    return sorted(images.values(), key=len, reverse=True)


def _joined(groups: Sequence[frozenset[int]]) -> set[int]:
    """The images of the largest group, and of groups that share two with it: these two have one distance."""
    joined = set(groups[0]) if groups else set[int]()
    apart = list(groups[1:])
    while near := [group for group in apart if len(group & joined) >= 2]:
        joined |= frozenset().union(*near)
        apart = [group for group in apart if group not in near]
    return joined


def depth_ratios(
    model: pycolmap.Reconstruction, pairs: Sequence[VerifiedPair], keypoints: Mapping[int, Array]
) -> list[DepthRatio]:
    """All comparisons of the depths of features that two pairs of one image share.

    ``keypoints`` maps image ids to positions [K, 2] in px of the full-size images. Only matches that fit the
    poses count.
    """
    matched = {i for pair in pairs for i in (pair.first, pair.second)}
    rays = normalised(model, {i: points for i, points in keypoints.items() if i in matched})
    least_sine = np.sin(np.radians(DEPTHS.min_parallax_deg))
    depths: dict[int, list[tuple[int, Array]]] = {i: [] for i in rays}
    for pair in pairs:
        if pair.first not in rays or pair.second not in rays:
            continue
        first, second = model.images[pair.first], model.images[pair.second]
        fits = pair.matches[fitting(pair, first, second, rays)]
        relative = second.cam_from_world() * first.cam_from_world().inverse()
        near, far, sine_squared = _depths(
            rays[pair.first][fits[:, 0]],
            rays[pair.second][fits[:, 1]],
            relative.rotation.matrix(),
            np.asarray(relative.translation),
        )
        informative = sine_squared >= least_sine**2
        informative &= (near > 0) & (far > 0)
        for image, other, column, depth in (
            (pair.first, pair.second, 0, near),
            (pair.second, pair.first, 1, far),
        ):
            if informative.sum() >= DEPTHS.min_tracks:
                log_depth = np.full(len(rays[image]), np.nan)
                log_depth[fits[informative, column]] = np.log(depth[informative])
                depths[image].append((other, log_depth))
    return [ratio for image, found in depths.items() for ratio in _compared(image, found)]


def _compared(image: int, depths: Sequence[tuple[int, Array]]) -> list[DepthRatio]:
    strongest = sorted(depths, key=lambda entry: -np.isfinite(entry[1]).sum())[: DEPTHS.max_pairs]
    ratios = []
    for (first, ours), (second, theirs) in combinations(strongest, 2):
        difference = ours - theirs
        difference = difference[np.isfinite(difference)]
        if len(difference) >= DEPTHS.min_tracks:
            median = _median(difference)
            scatter = 1.4826 * _median(np.abs(difference - median))
            ratios.append(DepthRatio(image, first, second, median, scatter))
    return ratios


def _median(values: Array) -> float:
    """The median of finite values, without the checks that take most of ``np.median``'s time here."""
    half = len(values) // 2
    if len(values) % 2 == 1:
        return float(np.partition(values, half)[half])
    return float(np.partition(values, (half - 1, half))[half - 1 : half + 1].mean())


def _depths(first: Array, second: Array, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
    """Depths of matched rays [M, 2] in both cameras, and the squared sines of the angles between them."""
    x, y = np.c_[first, np.ones(len(first))], np.c_[second, np.ones(len(second))]
    u = x @ rotation.T
    uu, yy, uy = (u * u).sum(axis=1), (y * y).sum(axis=1), (u * y).sum(axis=1)
    ut, yt = u @ translation, y @ translation
    determinant = np.maximum(uu * yy - uy**2, 1e-300)
    return (uy * yt - yy * ut) / determinant, (uu * yt - uy * ut) / determinant, determinant / (uu * yy)
