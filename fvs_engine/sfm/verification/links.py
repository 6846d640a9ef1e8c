"""Connectivity of the images of a model by its verified pairs."""

from collections.abc import Iterator, Sequence
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
    """More of the matches that join them with the rest agree on another pose than fit the model's."""

    unconnected: frozenset[str]
    """No explained pair connects them with the rest, and hardly any matches contradict them."""

    loose: frozenset[str]
    """Connected, but somewhere by pairs of few matches only, or of fewer than contradict them, as look-alike
    places often are.
    """

    @staticmethod
    def of(
        model: pycolmap.Reconstruction, checks: Sequence[PairCheck], least_share: float = PAIRS.min_link_share
    ) -> "Links":
        """The links that ``checks``, those of all pairs within the model, give.

        Pairs of which less than ``least_share`` of the features match and fit leave images loose.

        A group of images that is consistent in itself, and wrong relative to the rest, is on the smaller
        side of a cut across which more matches agree on another pose of it than fit the model's. Pairs of
        images that show different places match by chance, and the more images, the more such pairs: each
        gives another pose, so together they make the group loose, not contradicted. The relative poses of
        the pairs tell; without them every pair stands alone.
        """
        names = {i: image.name for i, image in model.images.items() if image.has_pose}
        ids = sorted(names)
        if not checks:
            return Links(frozenset(), frozenset(names.values()), frozenset())
        rotations = np.array([model.images[i].cam_from_world().rotation.matrix() for i in ids])
        graph = _Graph(ids, rotations, checks)
        found = (graph.contradicted(), graph.outside(), graph.loose(least_share) | graph.disputed())
        contradicted, outside, loose = (
            frozenset(names[ids[k]] for k in np.flatnonzero(mask)) for mask in found
        )
        return Links(contradicted, outside - contradicted, loose - outside - contradicted)


class _Graph:
    """Images as nodes, and the pairs between them; masks are over the images [N].

    ``rotations`` [N, 3, 3] are camera_from_model.
    """

    def __init__(
        self, ids: Sequence[int], rotations: NDArray[np.float64], checks: Sequence[PairCheck]
    ) -> None:
        index = {image_id: k for k, image_id in enumerate(ids)}
        self._size = len(ids)
        self._ends = np.array([(index[check.first], index[check.second]) for check in checks])
        self._matches = np.array([check.matches for check in checks])
        self._supported = np.array([check.supported for check in checks])
        self._features = np.array([check.features for check in checks])
        self._explained = np.array([explains(check) for check in checks])
        self._rotations = rotations
        self._relative = np.array(
            [
                np.full((3, 3), np.nan)
                if check.second_from_first is None
                else check.second_from_first.rotation
                for check in checks
            ]
        )

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
        for here, there in self._seams():
            if self._supported[self._between(here, there)].sum() < self._against(here, there):
                found |= here
        return found

    def disputed(self) -> NDArray[np.bool_]:
        """Groups on the smaller side of a cut that most of their matches with the rest contradict."""
        found = np.zeros(self._size, dtype=bool)
        for here, _ in self._seams():
            found |= here
        return found

    def _seams(self) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
        """The cuts across which most matches contradict the poses: the smaller side, and the other one."""
        group = self._groups(self._explained)
        main = np.bincount(group).argmax()
        # The spanning tree of the best supported pairs: an edge of it is the strongest link across its cut.
        tree = minimum_spanning_tree(self._weighted(self._explained)).tocoo()
        for k in np.flatnonzero(group[tree.row] == main):
            edges = np.arange(tree.nnz) != k
            cut = coo_array((tree.data[edges], (tree.row[edges], tree.col[edges])), shape=tree.shape)
            side = connected_components(cut, directed=False)[1]
            here, there = side == side[tree.row[k]], side == side[tree.col[k]]
            across = self._between(here, there)
            if self._supported[across].sum() < PAIRS.explained_share * self._matches[across].sum():
                yield (here, there) if here.sum() < there.sum() else (there, here)

    def _against(self, here: NDArray[np.bool_], there: NDArray[np.bool_]) -> int:
        """The most matches between two groups that agree on another pose of one relative to the other.

        They are of pairs that the model does not explain, and agree when the pairs turn the group alike.
        """
        pairs = np.flatnonzero(self._between(here, there) & ~self._explained)
        if len(pairs) == 0:
            return 0
        first, second = self._ends[pairs].T
        # The turn of the group of the second image, as the pair has it, relative to that of the first.
        turns = self._rotations[second].transpose(0, 2, 1) @ self._relative[pairs] @ self._rotations[first]
        turns[here[first]] = turns[here[first]].transpose(0, 2, 1)
        flat = turns.reshape(-1, 9)
        # Each may be off by the limit. The trace of a turn's inverse times another is their dot product.
        alike = flat @ flat.T > 1.0 + 2.0 * np.cos(np.radians(2.0 * PAIRS.max_rotation_deg))
        np.fill_diagonal(alike, True)  # also where the matches of a pair leave its relative pose open
        return int((alike @ (self._matches - self._supported)[pairs]).max())

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
