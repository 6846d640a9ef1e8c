"""The outlook: how well the targets are known now, after the next view, and at the end of a plan."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.fleet import Fleet, FleetPlan
from fvs_engine.plan.forecast import LEAST_PHOTOGRAPHS, PsnrForecast, Seen
from fvs_engine.plan.plan_records import Expectation, Outlook
from fvs_engine.plan.planner import plan_views
from fvs_engine.plan.targets import Targets


class Expectations:
    """Expectations by the photographs ``seen`` so far."""

    def __init__(self, seen: Sequence[Seen]) -> None:
        self._line = PsnrForecast(seen) if len(seen) >= LEAST_PHOTOGRAPHS else None

    def at(self, variance: float) -> Expectation:
        """The expectation at a mean variance."""
        return Expectation(variance=variance, forecast=self._line.at(variance) if self._line else None)

    def of_views(self, variances: NDArray[np.float64]) -> tuple[Expectation, ...]:
        """The expectation of each of some single views, which have these variances [V]."""
        forecasts = self._line.of_views(variances) if self._line else [None] * len(variances)
        return tuple(
            Expectation(variance=variance, forecast=forecast)
            for variance, forecast in zip(variances.tolist(), forecasts, strict=True)
        )

    @property
    def calibrated(self) -> bool:
        """Whether enough photographs were seen for a forecast."""
        return self._line is not None

    def gain_db(self, variance: float, variance_after: float) -> float | None:
        """The PSNR that a fall of the mean variance adds; None without a forecast."""
        return self._line.gain_db(variance, variance_after) if self._line else None


def look_ahead(
    targets: Targets,
    reachable: Sequence[str],
    remaining: int,
    seen: Sequence[Seen],
    fleet: Fleet | None = None,
) -> Outlook:
    """The outlook with ``remaining`` views to visit, of which one that is ``reachable`` comes next.

    ``fleet``: the vehicles, where their travel is limited or there are several (None: one without a limit).
    """
    expectations = Expectations(seen)
    among = np.array([targets.index[name] for name in reachable], dtype=np.int64)
    now = targets.variance.variance
    after_next = now - float(targets.variance.gains([], among).max(initial=0.0))
    if fleet is not None and fleet.distance is not None:
        end = FleetPlan(targets, remaining, fleet).variance_after
    else:
        end = plan_views(targets.variance, remaining, targets.admissible).variance_after
    return Outlook(
        now=expectations.at(now),
        after_next=expectations.at(after_next),
        end=expectations.at(end),
        gain_db=expectations.gain_db(now, after_next),
    )
