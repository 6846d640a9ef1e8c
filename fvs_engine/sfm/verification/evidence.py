"""Evidence for a model's poses from the two-view geometries, which do not depend on the model.

A mapper minimises the error of the matches that it kept; it reports a good fit even after discarding those
that contradict it. So every verified match of every pair is checked again here.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.report import Evidence
from fvs_engine.sfm.verification.pair_check import EXPLAINED, PairCheck, angle_deg, check_pairs, explains
from fvs_engine.sfm.verification.positions import misplaced, residual_share
from fvs_engine.sfm.verification.prior_support import prior_support

Array = NDArray[np.float64]

_MAX_ROTATION_DEG = 5.0
_MAX_DIRECTION_DEG = 15.0
_MAX_TRIPLETS = 20_000


def gather_evidence(
    model: pycolmap.Reconstruction,
    pairs: Sequence[VerifiedPair],
    keypoints: Mapping[int, Array],
    priors: PosePriors,
    on_pair: Callable[[], None] | None = None,
) -> Evidence | None:
    """The evidence for ``model`` of pairs and priors; None when no verified pair lies within it.

    It takes a hundredth of a second per pair; ``on_pair`` is called before each and may raise to stop.
    """
    checks = check_pairs(model, pairs, keypoints, on_pair=on_pair)
    if not checks:
        return None
    posed = [image for image in model.images.values() if image.has_pose]
    centres = {image.name: np.asarray(image.projection_center()) for image in posed}
    matches = np.array([check.matches for check in checks], dtype=np.float64)
    supported = np.array([check.supported for check in checks], dtype=np.float64)
    rotation = np.array([check.rotation_error_deg for check in checks])
    direction = np.array([check.direction_error_deg for check in checks])
    return Evidence(
        pairs=len(checks),
        matches=int(matches.sum()),
        match_support=float(supported.sum() / matches.sum()),
        rotation_support=_weighted_share(rotation, _MAX_ROTATION_DEG, matches),
        translation_support=_weighted_share(direction, _MAX_DIRECTION_DEG, matches),
        cycle_consistency=cycle_consistency(pairs),
        unsupported_images=tuple(sorted(_unsupported(model, checks))),
        misplaced_images=tuple(sorted(misplaced(priors, centres))),
        prior_residual_share=residual_share(priors, centres),
        prior_support=prior_support(
            checks,
            {image.image_id: image.name for image in posed},
            {image.image_id: image.cam_from_world().rotation.matrix().T for image in posed},
            priors,
        ),
    )


def cycle_consistency(pairs: Sequence[VerifiedPair]) -> float | None:
    """Share of the triplets whose three relative rotations close to 5°; None without triplets."""
    rotations: dict[int, dict[int, Array]] = {}
    for pair in pairs:
        if pair.second_from_first is not None:
            rotations.setdefault(pair.first, {})[pair.second] = pair.second_from_first.rotation
    closed = total = 0
    for ahead in rotations.values():
        for b, b_from_a in ahead.items():
            for c, c_from_b in rotations.get(b, {}).items():
                if c in ahead:
                    total += 1
                    closed += angle_deg(ahead[c].T @ c_from_b @ b_from_a) < _MAX_ROTATION_DEG
                    if total == _MAX_TRIPLETS:
                        return closed / total
    return closed / total if total > 0 else None


def _weighted_share(errors_deg: Array, limit_deg: float, weights: Array) -> float | None:
    known = np.isfinite(errors_deg)
    if not known.any():
        return None
    return float((weights[known] * (errors_deg[known] < limit_deg)).sum() / weights[known].sum())


def _unsupported(model: pycolmap.Reconstruction, checks: Sequence[PairCheck]) -> list[str]:
    """Names of the images that explained pairs do not connect with the rest of the model.

    They are outside the largest component of explained pairs, or on the smaller side of a cut across which
    most matches contradict the poses, though some pairs fit. A group of images that is consistent in itself,
    and wrong relative to the rest, looks like that.
    """
    ids = sorted(i for i, image in model.images.items() if image.has_pose)
    index = {image_id: k for k, image_id in enumerate(ids)}
    ends = np.array([(index[check.first], index[check.second]) for check in checks])
    matches = np.array([check.matches for check in checks])
    supported = np.array([check.supported for check in checks])
    explained = np.array([explains(check) for check in checks])
    rows, columns = ends[explained].T
    # The spanning tree of the best supported pairs: an edge of it is the strongest link across its cut.
    tree = minimum_spanning_tree(
        coo_array((1.0 / supported[explained], (rows, columns)), shape=(len(ids),) * 2)
    )
    group = connected_components(tree, directed=False)[1]
    outside = group != np.argmax(np.bincount(group))
    tree = tree.tocoo()
    for k in np.flatnonzero(~outside[tree.row]):
        edges = np.arange(tree.nnz) != k
        cut = coo_array((tree.data[edges], (tree.row[edges], tree.col[edges])), shape=tree.shape)
        side = connected_components(cut, directed=False)[1]
        here, there = side == side[tree.row[k]], side == side[tree.col[k]]
        across = (here[ends[:, 0]] & there[ends[:, 1]]) | (there[ends[:, 0]] & here[ends[:, 1]])
        if supported[across].sum() < EXPLAINED * matches[across].sum():
            outside |= here if here.sum() < there.sum() else there
    return [model.images[ids[k]].name for k in np.flatnonzero(outside)]
