"""Clearance: the solid parts of the model, and the positions and straight legs that keep clear of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.volumes import AnyVolume

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SOLID_OPACITY = 0.3
"""Opacity from which a Gaussian is matter.

Measured on two models of *fox* (38,000 and 20,000 Gaussians) with a safety distance of 2 % of the cameras'
spread. From a camera to 80 % of the distance of a point that it saw the way is certainly free; to 110 % it
leads through matter. With 0.3, 98.6 and 98.8 % of the first were free and 100 and 99.9 % of the second were
blocked. With 0.1, floaters left only 87 and 90 % free; with 0.7, 2 and 4 % led through surfaces. With 0.3 all
cameras were clear and saw the next one."""
RADIUS_SCALES = 1.0
"""Radius of a Gaussian's matter in its largest scale (standard deviation).

With 2, only 55 % of the ways that are free for certain were so, and 4 % of the cameras stood in matter."""
_CLASSES = 4
"""Classes of radii that are searched on their own; the radii of one differ by a factor of 2 at most."""
_RESOLUTION = 0.1
"""Longest unexamined part of a leg in safety distances: clearance may fall short by 0.2 %."""
_LEAST_RESOLUTION = 1e-3
"""The same in lengths of the leg, where that is longer."""
_MOST_INTERVALS = 100_000
_MOST_SEARCHED = 4
"""Number of safety distances whose search structures are cached: a service needs many."""


@dataclass(frozen=True, eq=False)
class Matter:
    """Solid balls: ``centres`` [M, 3] and ``radii`` [M], in the frame of the views.

    Raises ``InvalidInputError`` for other shapes, numbers that are not finite and negative radii.
    """

    centres: Array
    radii: Array
    _searched: dict[float, "list[_Balls]"] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        centres = np.asarray(self.centres, dtype=np.float64)
        radii = np.asarray(self.radii, dtype=np.float64)
        if centres.ndim != 2 or centres.shape[1] != 3 or radii.shape != centres.shape[:1]:
            raise InvalidInputError("Matter needs centres [M, 3] and as many radii.")
        if not (np.isfinite(centres).all() and np.isfinite(radii).all() and (radii >= 0.0).all()):
            raise InvalidInputError("Matter needs finite centres and radii of at least 0.")
        object.__setattr__(self, "centres", centres)
        object.__setattr__(self, "radii", radii)

    @staticmethod
    def none() -> "Matter":
        """Nothing is solid."""
        return Matter(np.zeros((0, 3)), np.zeros(0))

    @staticmethod
    def of_model(
        means: ArrayLike,
        scales: ArrayLike,
        opacities: ArrayLike,
        points: ArrayLike = (),
    ) -> "Matter":
        """The Gaussians of at least ``SOLID_OPACITY``, and sparse ``points`` [P, 3], which have no radius.

        ``means`` [N, 3]; ``scales`` [N, 3], standard deviations along the axes; ``opacities`` [N] in [0, 1].
        """
        solid = np.asarray(opacities, dtype=np.float64) >= SOLID_OPACITY
        sparse = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        radii = RADIUS_SCALES * np.asarray(scales, dtype=np.float64)[solid].max(axis=1, initial=0.0)
        return Matter(
            np.concatenate([np.asarray(means, dtype=np.float64)[solid], sparse]),
            np.concatenate([radii, np.zeros(len(sparse))]),
        )

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def middle(self) -> Array:
        """The median of the centres [3] along each axis. Raises ``InvalidInputError`` without matter."""
        self._require_some()
        return np.asarray(np.median(self.centres, axis=0))

    def nearest(self, points: Array) -> Array:
        """The centre [N, 3] that is nearest to each of ``points`` [N, 3].

        Raises ``InvalidInputError`` without matter.
        """
        from scipy.spatial import cKDTree  # slow to import

        self._require_some()
        return np.asarray(self.centres[cKDTree(self.centres).query(points)[1]])

    def clear(self, points: Array, safety: float) -> Mask:
        """Which of ``points`` [N, 3] are farther than ``safety`` from all matter."""
        mask = np.ones(len(points), dtype=np.bool_)
        for balls in self._within(safety):
            mask[mask] = balls.free(points[mask], 0.0) > 0.0
        return mask

    def sees(self, points: Array, others: Array, safety: float) -> Mask:
        """Between which ``points`` [N, 3] and the ``others`` of their rows no matter is within ``safety``.

        Each segment is halved where the free distance at its middle does not cover it. Parts shorter than a
        tenth of ``safety``, or 1/1000 of the segment if that is longer, are not examined.
        """
        mask = self.clear(points, safety)
        mask[mask] = self.clear(others[mask], safety)
        lengths = np.linalg.norm(others - points, axis=1)
        shortest = np.maximum(_RESOLUTION * safety, _LEAST_RESOLUTION * lengths)
        of = np.flatnonzero(mask)
        low, high = np.zeros(len(of)), lengths[of]
        # The last come first, so that the number of open intervals stays in proportion to the legs.
        while len(of):
            later = slice(0, max(0, len(of) - _MOST_INTERVALS))
            now = slice(later.stop, None)
            kept = of[later], low[later], high[later]
            of, low, high = self._left_of(
                points, others, lengths, mask, (of[now], low[now], high[now]), safety
            )
            long = mask[of] & (high - low > shortest[of])
            of, low, high = (
                np.concatenate(pair) for pair in zip(kept, (of[long], low[long], high[long]), strict=True)
            )
        return mask

    def _left_of(
        self,
        points: Array,
        others: Array,
        lengths: Array,
        mask: Mask,
        intervals: tuple[NDArray[np.int64], Array, Array],
        safety: float,
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """The parts of intervals not covered by free distances at the middles; clears blocked ``mask``."""
        of, low, high = intervals
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        share = (middle / np.maximum(lengths[of], 1e-300))[:, None]
        positions = points[of] + share * (others[of] - points[of])
        free = np.full(len(of), np.inf)
        for balls in self._within(safety):
            free = np.minimum(free, balls.free(positions, half))
        mask[of[free <= 0.0]] = False
        left = (free > 0.0) & (free < half)
        of, low, high, middle, free = of[left], low[left], high[left], middle[left], free[left]
        return (
            np.concatenate([of, of]),
            np.concatenate([low, middle + free]),
            np.concatenate([middle - free, high]),
        )

    def _within(self, safety: float) -> "list[_Balls]":
        """Matter grown by ``safety``, in classes of radii, ready to be searched."""
        if not 0.0 <= safety < np.inf:
            raise InvalidInputError(f"A safety distance must be at least 0 and finite, not {safety}.")
        if safety not in self._searched:
            while len(self._searched) >= _MOST_SEARCHED:
                del self._searched[next(iter(self._searched))]
            grown = self.radii + safety
            largest = grown.max(initial=0.0)
            steps = np.full(len(self), _CLASSES - 1)
            if largest > 0.0:
                with np.errstate(divide="ignore"):
                    steps = np.minimum(np.floor(np.log2(largest / grown)), _CLASSES - 1).astype(np.int64)
            # Small balls are the most, and are searched last: large ones have ruled out many points by then.
            self._searched[safety] = [
                _Balls(self.centres[steps == step], grown[steps == step])
                for step in range(_CLASSES)
                if (steps == step).any()
            ]
        return self._searched[safety]

    def _require_some(self) -> None:
        if not len(self):
            raise InvalidInputError(
                "The model has no solid part to aim at.",
                hint="Give a target, or a model with opaque Gaussians.",
            )


class _Balls:
    """Balls with radii of one class.

    R is the largest radius. With a fourth coordinate √(R² − r²) for the centre of a ball of radius r, a point
    is in a ball where their distance in four dimensions is R at most. What exceeds R is free in any case.
    """

    def __init__(self, centres: Array, radii: Array) -> None:
        from scipy.spatial import cKDTree  # slow to import

        self._largest = float(radii.max())
        lifted = np.sqrt(np.maximum(self._largest**2 - radii**2, 0.0))
        # Split in the middle: sight lines around a surface take half the time that balanced trees take.
        self._tree = cKDTree(np.column_stack([centres, lifted]), balanced_tree=False, compact_nodes=False)

    def free(self, points: Array, most: Array | float) -> Array:
        """A distance [N] free of balls around each of ``points`` [N, 3]: positive exactly outside of all.

        Infinite where it is more than ``most`` [N].
        """
        lifted = np.column_stack([points, np.zeros(len(points))])
        # One bound for all points, so that each is searched no further than needed by the largest of them.
        bound = self._largest + float(np.max(most, initial=0.0))
        distances, _ = self._tree.query(lifted, distance_upper_bound=np.nextafter(bound, np.inf))
        return np.asarray(distances - self._largest)


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Where a vehicle may be: farther than ``safety`` from ``matter``, and in no ``no_fly`` zone.

    With ``reach``, only within that distance of ``start`` [3]. ``monitor`` stops tests of many positions or
    legs, which then raise ``Cancelled``. Raises ``InvalidInputError`` where one of the
    two is given without the other or a number is out of range.
    """

    matter: Matter = field(default_factory=Matter.none)
    safety: float = 0.0
    no_fly: Sequence[AnyVolume] = ()
    start: Array | None = None
    reach: float | None = None
    monitor: Monitor = field(default_factory=Monitor, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 <= self.safety < np.inf:
            raise InvalidInputError(f"A safety distance must be at least 0 and finite, not {self.safety}.")
        if (self.start is None) != (self.reach is None):
            raise InvalidInputError("A reach needs the start from which it counts, and a start its reach.")
        if self.reach is not None and not 0.0 < self.reach < np.inf:
            raise InvalidInputError(f"A reach must be positive and finite, not {self.reach}.")

    def allowed(self, points: Array) -> Mask:
        """Which of ``points`` [N, 3] are in no zone."""
        mask = np.ones(len(points), dtype=np.bool_)
        for zone in self.no_fly:
            self.monitor.check()
            mask[mask] = ~zone.contains(points[mask])
        return mask

    def within_reach(self, points: Array) -> Mask:
        """Which of ``points`` [N, 3] are in reach of the start."""
        if self.start is None or self.reach is None:
            return np.ones(len(points), dtype=np.bool_)
        return np.asarray(np.linalg.norm(points - np.asarray(self.start), axis=1) <= self.reach)

    def clear(self, points: Array) -> Mask:
        """Which of ``points`` [N, 3] are clear of matter."""
        self.monitor.check()
        return self.matter.clear(points, self.safety)

    def joins(self, points: Array, others: Array) -> Mask:
        """Between which ``points`` [N, 3] and the ``others`` of their rows a straight leg can be flown."""
        mask = np.ones(len(points), dtype=np.bool_)
        for zone in self.no_fly:
            self.monitor.check()
            mask[mask] = ~zone.crossed(points[mask], others[mask])
        self.monitor.check()
        mask[mask] = self.matter.sees(points[mask], others[mask], self.safety)
        return mask
