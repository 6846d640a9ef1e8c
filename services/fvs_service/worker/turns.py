"""Whose turn it is in a scene: one job at a time, updates before fine models.

Somebody in the field waits for an update, and it takes seconds or minutes; a fine model takes hours and loses
nothing when it pauses.
"""

import threading
from collections import Counter
from collections.abc import Callable

from fvs_service.jobs.model import JobKind

_POLL_S = 0.25


class Turns:
    """Gives turns to the jobs of one worker; safe to use from any thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._taken: set[str] = set()
        self._updates_waiting: Counter[str] = Counter()

    def take(self, scene_id: str, kind: JobKind, give_up: Callable[[], bool]) -> bool:
        """Wait for a turn; False when ``give_up`` said so first."""
        updating = kind is JobKind.UPDATE
        with self._changed:
            self._updates_waiting[scene_id] += updating
            try:
                while scene_id in self._taken or (not updating and self._updates_waiting[scene_id]):
                    self._changed.wait(_POLL_S)
                    if give_up():
                        return False
                self._taken.add(scene_id)
                return True
            finally:
                self._updates_waiting[scene_id] -= updating
                self._changed.notify_all()

    def end(self, scene_id: str) -> None:
        """The turn is over."""
        with self._changed:
            self._taken.discard(scene_id)
            self._changed.notify_all()

    def update_waits(self, scene_id: str) -> bool:
        """Whether an update waits for a turn in the scene."""
        return self._updates_waiting[scene_id] > 0
