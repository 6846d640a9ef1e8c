"""Connectivity of the images of a model by its verified pairs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, PairCheck, explains
from fvs_engine.sfm.verification.thresholds import PAIRS


@dataclass(frozen=True)
class Links:
    """Names of the images of a model that are not, or not well, connected with the rest of it."""

    contradicted: frozenset[str]
    """Most of the matches that join them with the rest contradict the poses, though some pairs may fit."""

    unconnected: frozenset[str]
    """No explained pair connects them with the rest, and hardly any matches contradict them."""

    loose: frozenset[str]
    """Connected, but somewhere by pairs of few matches only, as look-alike places often are."""

    @staticmethod
    def of(
        model: pycolmap.Reconstruction, checks: Sequence[PairCheck], least_share: float = PAIRS.min_link_share
    ) -> "Links":
        """The links that ``checks``, those of all pairs within the model, give.

        Pairs of which less than ``least_share`` of the features match and fit leave images loose.

        A group of images that is consistent in itself, and wrong relative to the rest, is on the smaller
        side of a cut across which most matches contradict the poses, or few fit.
        """
        names = {i: image.name for i, image in model.images.items() if image.has_pose}
        ids = sorted(names)
        if not checks:
            return Links(frozenset(), frozenset(names.values()), frozenset())
        graph = _Graph(ids, checks)
        found = (graph.contradicted(), graph.outside(), graph.loose(least_share))
        contradicted, outside, loose = (
            frozenset(names[ids[k]] for k in np.flatnonzero(mask)) for mask in found
        )
        return Links(contradicted, outside - contradicted, loose - outside - contradicted)


class _Graph:
    """Images as nodes, and the pairs between them; masks are over the images [N]."""

    def __init__(self, ids: Sequence[int], checks: Sequence[PairCheck]) -> None:
        index = {image_id: k for k, image_id in enumerate(ids)}
        self._size = len(ids)
        self._ends = np.array([(index[check.first], index[check.second]) for check in checks])
        self._matches = np.array([check.matches for check in checks])
        self._supported = np.array([check.supported for check in checks])
        self._features = np.array([check.features for check in checks])
        self._explained = np.array([explains(check) for check in checks])

    def outside(self) -> NDArray[np.bool_]:
        """The images that explained pairs do not connect with the most."""
        return self._apart(self._explained)

    def loose(self, least_share: float) -> NDArray[np.bool_]:
        """The images that explained pairs of enough matches do not connect with the most."""
        return self._apart(self._explained & (self._supported >= least_share * self._features))

    def contradicted(self) -> NDArray[np.bool_]:
        """Groups outside, or on the smaller side of a cut, that their matches with the rest contradict."""
        found = np.zeros(self._size, dtype=bool)
        group = self._groups(self._explained)
        main = np.bincount(group).argmax()
        for number in set(group.tolist()) - {int(main)}:
            across = self._between(group == number, group != number)
            if self._matches[across].sum() >= MIN_PAIR_MATCHES:
                found |= group == number
        # The spanning tree of the best supported pairs: an edge of it is the strongest link across its cut.
        tree = minimum_spanning_tree(self._weighted(self._explained)).tocoo()
        for k in np.flatnonzero(group[tree.row] == main):
            edges = np.arange(tree.nnz) != k
            cut = coo_array((tree.data[edges], (tree.row[edges], tree.col[edges])), shape=tree.shape)
            side = connected_components(cut, directed=False)[1]
            here, there = side == side[tree.row[k]], side == side[tree.col[k]]
            across = self._between(here, there)
            if self._supported[across].sum() < PAIRS.explained_share * self._matches[across].sum():
                found |= here if here.sum() < there.sum() else there
        return found

    def _apart(self, edges: NDArray[np.bool_]) -> NDArray[np.bool_]:
        group = self._groups(edges)
        return np.asarray(group != np.bincount(group).argmax())

    def _groups(self, edges: NDArray[np.bool_]) -> NDArray[np.int32]:
        return np.asarray(connected_components(self._weighted(edges), directed=False)[1])

    def _weighted(self, edges: NDArray[np.bool_]) -> coo_array:
        rows, columns = self._ends[edges].T
        return coo_array((1.0 / self._supported[edges], (rows, columns)), shape=(self._size, self._size))

    def _between(self, here: NDArray[np.bool_], there: NDArray[np.bool_]) -> NDArray[np.bool_]:
        first, second = self._ends.T
        return np.asarray((here[first] & there[second]) | (there[first] & here[second]))
