"""Selection of the earlier images that a new one is matched with; their number is bounded."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.files.atomic import replacing
from fvs_engine.sfm.colmap.database import verified_matches
from fvs_engine.sfm.matching.match import match_pairs
from fvs_engine.sfm.matching.retrieval import compute_vocabulary, describe
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.settings import GrowthSettings
from fvs_engine.sfm.stages import Stages
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES

_BEST_MATCHED = 3
"""Number of an image's best matched neighbours at which the search in space starts."""

_ALSO_SIMILAR = 4
"""Number of most similar images that one is matched with, besides those suggested by its pose prior."""

Descriptors = Callable[[str], NDArray[np.float32]]
"""Name → descriptors [K, 128]."""


class ImageRetrieval:
    """Similarity of images by one vocabulary, so that an image's neighbours do not depend on later images."""

    def __init__(self, words: NDArray[np.float32] | None, read: Descriptors) -> None:
        self._words = words
        self._read = read
        self._vectors: dict[str, NDArray[np.float32]] = {}

    @classmethod
    def open(cls, file: Path, names: Sequence[str], seed: int, read: Descriptors) -> "ImageRetrieval":
        """Read the vocabulary in ``file``; a missing one is computed from ``names`` and written there."""
        if not file.is_file():
            words = compute_vocabulary([read(name) for name in names], seed)
            with replacing(file) as temporary, temporary.open("wb") as stream:
                np.savez(stream, words=np.zeros((0, 128), np.float32) if words is None else words)
        with np.load(file) as kept:
            words = kept["words"]
        return cls(words if len(words) > 0 else None, read)

    def prepare(self, names: Sequence[str]) -> None:
        """Compute descriptors of images ahead of the next search."""
        if self._words is not None:
            for name in names:
                self._vector(name)

    def most_similar(self, name: str, others: Sequence[str], count: int) -> list[str]:
        """The ``count`` of ``others`` that are most similar to ``name``, the most similar first."""
        if self._words is None or not others:
            return list(others[:count])
        similarity = np.stack([self._vector(other) for other in others]) @ self._vector(name)
        return [others[int(i)] for i in np.argsort(-similarity, kind="stable")[:count]]

    def _vector(self, name: str) -> NDArray[np.float32]:
        if name not in self._vectors:
            assert self._words is not None
            self._vectors[name] = describe(self._words, self._read(name))
        return self._vectors[name]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The images among which neighbours are chosen: ``earlier``, in the order of adding, and their model."""

    earlier: Sequence[str]
    model: Reconstruction
    retrieval: ImageRetrieval


def match_with_neighbours(
    stages: Stages,
    images: Sequence[str],
    around: Surroundings,
    fetch: Callable[[Sequence[str]], None] | None = None,
    predicted: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, list[str]]:
    """Match each of ``images`` with its neighbours among those ``around``.

    Images in ``predicted`` are matched first with their predicted neighbours (by overlap, the most likely
    first) and some similar images. Others, and those that match none of these, are matched with the
    neighbours that capture order and similarity suggest, and then with those whose cameras are near the best
    matches. ``fetch`` is called with the images whose features are needed next. Returns each image's
    neighbours.
    """
    growth, earlier, retrieval = stages.settings.growth, around.earlier, around.retrieval
    centres = around.model.centres()
    expected = {name: predicted[name] for name in images if name in predicted} if predicted else {}
    chosen: dict[str, list[str]] = {name: [] for name in images}
    for name, likely in expected.items():
        others = [other for other in earlier if other != name]
        chosen[name] = list(dict.fromkeys([*likely, *retrieval.most_similar(name, others, _ALSO_SIMILAR)]))
    _match(stages, chosen, fetch)
    verified = verified_matches(stages.folder.database, MIN_PAIR_MATCHES) if expected else {}
    unexpected = [name for name in images if not _matched(verified, name, chosen[name])]
    for name in unexpected:
        stages.monitor.check()
        first = first_neighbours(name, earlier, retrieval, growth)
        chosen[name] = list(dict.fromkeys([*chosen[name], *first]))
    _match(stages, chosen, fetch)
    verified = verified_matches(stages.folder.database, MIN_PAIR_MATCHES)
    for name in unexpected:
        near = neighbours_in_space(_matched(verified, name, chosen[name]), centres, growth)
        chosen[name] = list(dict.fromkeys([*chosen[name], *near]))
    _match(stages, chosen, fetch)
    return chosen


def _matched(verified: Mapping[tuple[str, str], int], name: str, others: Sequence[str]) -> dict[str, int]:
    """Those of ``others`` that form a ``verified`` pair with an image → the number of matches."""
    counts = {other: max(verified.get((name, other), 0), verified.get((other, name), 0)) for other in others}
    return {other: count for other, count in counts.items() if count > 0}


def _match(
    stages: Stages, chosen: Mapping[str, Sequence[str]], fetch: Callable[[Sequence[str]], None] | None
) -> None:
    pairs = [(name, other) for name, others in chosen.items() for other in others if other != name]
    if fetch is not None:
        fetch(sorted({other for _, other in pairs}))
    match_pairs(stages, list({frozenset(pair): pair for pair in pairs}.values()))


def first_neighbours(
    name: str, earlier: Sequence[str], retrieval: ImageRetrieval, settings: GrowthSettings
) -> list[str]:
    """The images that an image of unknown pose is matched with.

    ``earlier`` is in the order of adding. Those nearest in capture order, those added last, and the most
    similar: every criterion adds images, so a misleading one costs only time.
    """
    others = [other for other in earlier if other != name]
    ordered = sorted(others)
    index = bisect_left(ordered, name)
    reach = settings.neighbours_in_order
    in_order = ordered[max(index - reach, 0) : index + reach]
    recent = others[len(others) - min(settings.neighbours_recent, len(others)) :]
    similar = retrieval.most_similar(name, others, settings.neighbours_by_similarity)
    return list(dict.fromkeys([*in_order, *recent, *similar]))


def neighbours_in_space(
    matches: Mapping[str, int], centres: Mapping[str, NDArray[np.float64]], settings: GrowthSettings
) -> list[str]:
    """The images whose cameras are nearest to those with which an image has the most verified ``matches``.

    The pose of the image itself need not be known.
    """
    best = sorted((name for name in matches if name in centres), key=lambda name: (-matches[name], name))
    best = best[:_BEST_MATCHED]
    names = sorted(centres)
    if not best or settings.neighbours_in_space == 0:
        return []
    positions = np.stack([centres[name] for name in names])
    to_best = np.stack([np.linalg.norm(positions - centres[name], axis=1) for name in best]).min(axis=0)
    return [
        names[int(i)]
        for i in np.argsort(to_best, kind="stable")[: settings.neighbours_in_space + len(best)]
        if names[int(i)] not in best
    ][: settings.neighbours_in_space]
