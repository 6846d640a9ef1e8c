"""Stop conditions of a selection."""

import time
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.plan_records import Outlook
from fvs_engine.plan.reach import Reach, rounded_up
from fvs_engine.select.loop_records import StopReason

_LEAST_SHARE = 1e-6
"""Tolerance for rounding, as a share of the way to a view."""


class Clock:
    """The time that one run of a selection may take; ``limit_s`` None means no limit."""

    def __init__(self, limit_s: float | None) -> None:
        self.limit_s = limit_s
        self._began = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        """Seconds since the clock was made."""
        return time.monotonic() - self._began

    def forbids(self, next_step_s: float) -> bool:
        """Whether a step that takes ``next_step_s`` would end too late."""
        return self.limit_s is not None and self.elapsed_s + next_step_s > self.limit_s


def budget_spent(visited: int, budget: int) -> StopReason | None:
    """Stop when the budget is used."""
    if visited < budget:
        return None
    return StopReason(kind="budget", message=f"The budget of {budget} views is used.")


def time_is_up(clock: Clock, last_step_s: float) -> StopReason | None:
    """Stop when another step as long as the last would end after the limit."""
    if not clock.forbids(last_step_s):
        return None
    return StopReason(
        kind="time-limit",
        message=f"After {clock.elapsed_s:.0f} s another step would not end within the time limit of "
        f"{clock.limit_s:g} s.",
    )


def quality_reached(outlook: Outlook, stop_at_db: float | None) -> StopReason | None:
    """Stop when the expected PSNR of the targets is high enough."""
    forecast = outlook.now.forecast
    if stop_at_db is None or forecast is None or forecast.db < stop_at_db:
        return None
    return StopReason(
        kind="quality",
        message=f"The expected PSNR reaches {stop_at_db:g} dB: {forecast.db:.1f} dB, "
        f"{forecast.low_db:.1f} to {forecast.high_db:.1f} in four of five cases.",
    )


def gain_too_small(outlook: Outlook, stop_at_gain_db: float | None) -> StopReason | None:
    """Stop when no view in reach adds enough."""
    gain = outlook.gain_db
    if stop_at_gain_db is None or gain is None or gain >= stop_at_gain_db:
        return None
    return StopReason(
        kind="gain",
        message=f"The next view is expected to add {gain:.2f} dB, less than {stop_at_gain_db:g} dB.",
    )


def nothing_in_reach(
    reach: Reach, here: NDArray[np.float64], unvisited: Mapping[str, NDArray[np.float64]]
) -> StopReason | None:
    """Stop when no unvisited view (name → centre [3]) is in reach; name a radius that reaches one."""
    if reach.distances(here, unvisited):
        return None
    if not unvisited:
        return StopReason(kind="nothing-in-reach", message="Every view that may be visited was visited.")
    nearest = next(iter(Reach(nearest=1).distances(here, unvisited).values()))
    return StopReason(
        kind="nothing-in-reach",
        message=f"None of the {len(unvisited)} unvisited views is within {reach.radius:.4g} of the camera; "
        f"a radius of {rounded_up(nearest):.4g} would reach the nearest.",
    )


def grounded(
    reach: Reach, left: float, here: NDArray[np.float64], unvisited: Mapping[str, NDArray[np.float64]]
) -> StopReason | None:
    """Stop when no unvisited view is in reach, or within what is ``left`` of the travel."""
    stop = nothing_in_reach(reach, here, unvisited)
    if stop is not None:
        return stop
    name, distance = next(iter(Reach(nearest=1).distances(here, unvisited).items()))
    return _travel_used(f"the nearest unvisited view, {name},", distance, left)


def too_far(name: str, distance: float, left: float) -> StopReason | None:
    """Stop when the path to the next view would exceed the travel that is ``left``."""
    return _travel_used(f"the next view, {name},", distance, left)


def _travel_used(view: str, distance: float, left: float) -> StopReason | None:
    if distance <= left:
        return None
    shown = left if left > _LEAST_SHARE * distance else 0.0
    return StopReason(
        kind="travel", message=f"The travel is used: {view} is {distance:.4g} away, and {shown:.4g} is left."
    )


def check_first_step(
    reach: Reach,
    max_travel: float | None,
    here: NDArray[np.float64],
    unvisited: Mapping[str, NDArray[np.float64]],
) -> None:
    """Raise ``InvalidInputError`` where a selection cannot make its first step from ``here`` [3]."""
    stop = nothing_in_reach(reach, here, unvisited)
    if stop is not None:
        raise InvalidInputError(stop.message, hint="Choose a larger radius, or how many of the nearest.")
    nearest = next(iter(Reach(nearest=1).distances(here, unvisited).values()))
    if max_travel is not None and nearest > max_travel:
        raise InvalidInputError(
            f"A travel of {max_travel:.4g} reaches no view: the nearest is {nearest:.4g} from the last "
            "initial one.",
            hint=f"Give --max-travel of at least {rounded_up(nearest):.4g}.",
        )
