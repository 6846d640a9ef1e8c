"""Whether pose priors fit the images, whatever the model's camera centres: the baselines of verified pairs.

A model that contradicts its priors is wrong, or they are. Most pairs of a wrong model are still right, and
their baselines have the directions that good priors give them; those of bad priors have them by chance.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.pair_check import PairCheck
from fvs_engine.sfm.verification.thresholds import PRIORS

Array = NDArray[np.float64]


def limits_deg(lengths: Array, sigmas: Array) -> Array:
    """Angles that contradict baselines of these lengths, given the standard deviations of their ends."""
    return np.asarray(PRIORS.max_direction_deg + np.degrees(np.arctan2(PRIORS.sigmas * sigmas, lengths)))


def prior_support(
    checks: Sequence[PairCheck],
    names: Mapping[int, str],
    rotations: Mapping[int, Array],
    priors: PosePriors,
) -> float | None:
    """Share of the pairs, weighted by matches, whose baselines fit the position priors; None for few pairs.

    ``names`` and ``rotations`` map image ids to names and to model_from_camera [3, 3]. The frames of model
    and priors are joined by the rotation that most pairs agree with; or each baseline is turned by the
    orientation prior of its first camera, when that fits more pairs.
    """
    tested = [
        check
        for check in checks
        if check.baseline is not None and {names[check.first], names[check.second]} <= priors.by_name.keys()
    ]
    if len(tested) < PRIORS.min_pairs:
        return None
    first, second = ([names[check.first] for check in tested], [names[check.second] for check in tested])
    expected = priors.positions(second) - priors.positions(first)
    lengths = np.linalg.norm(expected, axis=1)
    sigmas = np.maximum(priors.position_sigmas(first), priors.position_sigmas(second))
    limits = limits_deg(lengths, sigmas)
    informative = (limits <= PRIORS.max_limit_deg) & (lengths > 0)
    if informative.sum() < PRIORS.min_pairs:
        return None
    in_camera = np.stack([np.asarray(check.baseline) for check in tested])[informative]
    in_model = np.stack([rotations[check.first] @ np.asarray(check.baseline) for check in tested])[
        informative
    ]
    directions = expected[informative] / lengths[informative, None]
    weights = np.array([check.matches for check in tested], dtype=np.float64)[informative]
    least = np.cos(np.radians(limits[informative]))
    candidates = _rotations(in_model, directions)
    agreeing = np.einsum("kij,pj,pi->kp", candidates, in_model, directions) >= least
    support = float((agreeing @ weights).max() / weights.sum())
    turned, oriented = _by_orientations(
        in_camera, [name for name, k in zip(first, informative, strict=True) if k], priors
    )
    if oriented.sum() >= PRIORS.min_pairs:
        fits = (turned * directions).sum(axis=1) >= least
        support = max(support, float((weights * fits)[oriented].sum() / weights[oriented].sum()))
    return support


def _rotations(source: Array, target: Array) -> Array:
    """Rotations [K, 3, 3] that each bring two of the directions ``source`` [P, 3] to those of ``target``."""
    random = np.random.default_rng(0)
    chosen = np.stack([random.choice(len(source), size=2, replace=False) for _ in range(PRIORS.samples)])
    return np.asarray(_triads(target[chosen]) @ np.swapaxes(_triads(source[chosen]), 1, 2))


def _triads(pairs: Array) -> Array:
    """Orthonormal axes [K, 3, 3] (columns) of two directions each [K, 2, 3], the first as first axis."""
    across = np.cross(pairs[:, 0], pairs[:, 1])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-300), np.nan)
    return np.stack([pairs[:, 0], across, np.cross(pairs[:, 0], across)], axis=2)


def _by_orientations(
    baselines: Array, names: Sequence[str], priors: PosePriors
) -> tuple[Array, NDArray[np.bool_]]:
    """The baselines [P, 3] turned by the orientation priors of ``names``, and which have one."""
    turned, oriented = np.zeros_like(baselines), np.zeros(len(baselines), dtype=bool)
    known = {name: priors.by_name[name].rotation for name in set(names)}
    for index, name in enumerate(names):
        rotation = known[name]
        if rotation is not None:
            turned[index], oriented[index] = rotation @ baselines[index], True
    return turned, oriented
