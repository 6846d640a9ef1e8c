"""Statistics over a handful of runs: means with confidence intervals, and paired differences."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import t as student_t

from fvs_engine.errors import InvalidInputError
from fvs_engine.records import Record

CONFIDENCE = 0.95


class Estimate(Record):
    """The mean of ``count`` independent values; it lies within ``half_width`` of the true one.

    ``half_width`` is that of the two-sided 95 % interval of Student's t, which is valid for few values;
    None for a single value, whose spread is unknown.
    """

    mean: float
    half_width: float | None
    count: int

    @property
    def low(self) -> float | None:
        """The lower end of the interval."""
        return None if self.half_width is None else self.mean - self.half_width

    @property
    def high(self) -> float | None:
        """The upper end of the interval."""
        return None if self.half_width is None else self.mean + self.half_width


def estimate(values: Sequence[float]) -> Estimate:
    """Mean and interval of independent ``values``.

    Raises ``InvalidInputError`` when there is none or one is not finite.
    """
    numbers = np.asarray(values, np.float64)
    if numbers.size == 0 or not np.isfinite(numbers).all():
        raise InvalidInputError("A mean needs at least one value, and finite ones only.")
    count = numbers.size
    half_width = None
    if count > 1:
        quantile = float(student_t.ppf((1 + CONFIDENCE) / 2, count - 1))
        half_width = quantile * float(numbers.std(ddof=1)) / math.sqrt(count)
    return Estimate(mean=float(numbers.mean()), half_width=half_width, count=count)


def paired_difference(values: Mapping[int, float], baseline: Mapping[int, float]) -> Estimate | None:
    """The mean difference ``values`` − ``baseline``, both by seed; None when they share no seed.

    Two selectors that start from the same views share the effect of that start. It cancels in the
    differences seed by seed, so their interval is narrower than those of the two means suggest.
    """
    shared = sorted(values.keys() & baseline.keys())
    return estimate([values[seed] - baseline[seed] for seed in shared]) if shared else None
