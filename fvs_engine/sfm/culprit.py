"""Search for the image that kills a native job, by running the job on parts of its images.

A job may die without any image being at fault: memory ran out, or somebody killed its process. So an image
is the culprit only if the job dies on it again and again, and not on another one.
"""

import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from fvs_engine.errors import NativeJobError

Item = TypeVar("Item")

_MOST_TOGETHER = 8
"""The job is run without each one of so many items that kill it only together."""
_CRASHES = 2
_KILLS = 3
"""Times that the job must die again on the culprit: more often when somebody else may have killed it."""
_CONTROLS = 2
_SEARCH_S = 600.0
_SEARCH_SHARE = 4.0
"""The search ends after this time, or this multiple of the time until the job died, whichever is longer."""


class _OutOfTimeError(Exception):
    """The search has taken too long."""


def run_or_accuse(
    run: Callable[[Sequence[Item]], object], items: Sequence[Item], controls: Sequence[Item] = ()
) -> tuple[Item, NativeJobError] | None:
    """Run a native job on ``items``; None when it has succeeded, else the culprit and how the job died.

    ``run`` may be called again, also with a part of the items, but with no item before those that precede it:
    COLMAP numbers images as they arrive, and the numbers affect the last digits of a model. ``controls`` are
    items outside of ``items`` on which the job is known to succeed. Raises the job's ``NativeJobError`` when
    no item alone is at fault.
    """
    began = time.monotonic()
    try:
        run(items)
    except NativeJobError as error:
        patience_s = max(_SEARCH_S, _SEARCH_SHARE * (time.monotonic() - began))
        search = _Search(run, error, time.monotonic() + patience_s)
    else:
        return None
    if not search.dies(items):  # somebody had killed it once
        return None
    try:
        culprit = search.culprit(items, controls)
    except _OutOfTimeError:
        culprit = None
    if culprit is None:
        raise search.error
    return culprit, search.error


class _Search(Generic[Item]):
    """Runs the job on parts of its items."""

    def __init__(self, run: Callable[[Sequence[Item]], object], error: NativeJobError, until: float) -> None:
        self.error = error
        self._run = run
        self._until = until

    def dies(self, items: Sequence[Item]) -> bool:
        """Whether the job dies on these items; it lives on none."""
        if not items:
            return False
        if time.monotonic() > self._until:
            raise _OutOfTimeError
        try:
            self._run(items)
        except NativeJobError as error:
            self.error = error
            return True
        return False

    def culprit(self, items: Sequence[Item], controls: Sequence[Item]) -> Item | None:
        """The item on which alone the job dies; of some that kill it only together, the last one."""
        group = self._smallest_group(items)
        if len(group) > _MOST_TOGETHER:
            return None
        suspect = next((item for item in reversed(group) if not self.dies(_without(group, item))), None)
        if suspect is not None and self._confirmed(group) and self._innocent_live(items, controls, suspect):
            return suspect
        return None

    def _smallest_group(self, items: Sequence[Item]) -> Sequence[Item]:
        """Items that kill the job although neither half of them does."""
        group = items
        while len(group) > 1:
            half = len(group) // 2
            later, earlier = group[half:], group[:half]
            if self.dies(earlier):
                group = earlier
            elif self.dies(later):
                group = later
            else:
                break
        return group

    def _confirmed(self, group: Sequence[Item]) -> bool:
        return all(self.dies(group) for _ in range(_CRASHES if self.error.crashed else _KILLS))

    def _innocent_live(self, items: Sequence[Item], controls: Sequence[Item], suspect: Item) -> bool:
        """Whether the job lives on another item, so that the fault is not the machine's."""
        error = self.error
        others = [*controls, *(item for item in items if item != suspect)][:_CONTROLS]
        lives = any(not self.dies([other]) for other in others) if others else error.crashed
        self.error = error
        return lives


def _without(items: Sequence[Item], left_out: Item) -> list[Item]:
    return [item for item in items if item != left_out]
