"""Search for the image that crashes a native job, by running the job on parts of its images.

A job may also fail through no fault of an image: memory ran out, or its process was killed. So an image is
the culprit only if it crashes the job in every run, and another image does not.
"""

import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from fvs_engine.errors import NativeJobError

Item = TypeVar("Item")

_MOST_TOGETHER = 8
"""Maximum size of a group that crashes the job only together for which each item is left out in turn."""
_CRASHES = 2
_KILLS = 3
"""Further runs that the culprit must crash; more when its process may have been killed from outside."""
_CONTROLS = 2
_SEARCH_S = 600.0
_SEARCH_SHARE = 4.0
"""The search ends after this time, or this multiple of the time to the crash, whichever is longer."""


class _OutOfTimeError(Exception):
    """The search has taken too long."""


def run_or_accuse(
    run: Callable[[Sequence[Item]], object], items: Sequence[Item], controls: Sequence[Item] = ()
) -> tuple[Item, NativeJobError] | None:
    """Run a native job on ``items``; None when it has succeeded, else the culprit and the error of the crash.

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
    if not search.crashes(items):  # its process was killed once
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

    def crashes(self, items: Sequence[Item]) -> bool:
        """Whether the job crashes on these items; it always succeeds on an empty list."""
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
        """The item that alone crashes the job; of several that crash it only together, the last one."""
        group = self._smallest_group(items)
        if len(group) > _MOST_TOGETHER:
            return None
        suspect = next((item for item in reversed(group) if not self.crashes(_without(group, item))), None)
        if (
            suspect is not None
            and self._confirmed(group)
            and self._innocent_succeed(items, controls, suspect)
        ):
            return suspect
        return None

    def _smallest_group(self, items: Sequence[Item]) -> Sequence[Item]:
        """Items that crash the job although neither half of them does."""
        group = items
        while len(group) > 1:
            half = len(group) // 2
            later, earlier = group[half:], group[:half]
            if self.crashes(earlier):
                group = earlier
            elif self.crashes(later):
                group = later
            else:
                break
        return group

    def _confirmed(self, group: Sequence[Item]) -> bool:
        return all(self.crashes(group) for _ in range(_CRASHES if self.error.crashed else _KILLS))

    def _innocent_succeed(self, items: Sequence[Item], controls: Sequence[Item], suspect: Item) -> bool:
        """Whether the job succeeds on another item, so that the fault is not the machine's."""
        error = self.error
        others = [*controls, *(item for item in items if item != suspect)][:_CONTROLS]
        succeeds = any(not self.crashes([other]) for other in others) if others else error.crashed
        self.error = error
        return succeeds


def _without(items: Sequence[Item], left_out: Item) -> list[Item]:
    return [item for item in items if item != left_out]
