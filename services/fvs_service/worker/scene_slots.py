"""One job at a time per scene, and updates before fine models.

An operator in the field needs the result of an update, which takes seconds or minutes; a fine model takes
hours and loses nothing when it pauses.
"""

import threading
from collections import Counter
from collections.abc import Callable

from fvs_service.jobs.model import JobKind

_POLL_S = 0.25


class SceneSlots:
    """The slots of one worker, one per scene; safe to use from any thread."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._occupied: set[str] = set()
        self._updates_waiting: Counter[str] = Counter()

    def acquire(self, scene_id: str, kind: JobKind, give_up: Callable[[], bool]) -> bool:
        """Wait for the scene's slot; False when ``give_up`` returned True first."""
        updating = kind is JobKind.UPDATE
        with self._changed:
            self._updates_waiting[scene_id] += updating
            try:
                while scene_id in self._occupied or (not updating and self._updates_waiting[scene_id]):
                    self._changed.wait(_POLL_S)
                    if give_up():
                        return False
                self._occupied.add(scene_id)
                return True
            finally:
                self._updates_waiting[scene_id] -= updating
                self._changed.notify_all()

    def release(self, scene_id: str) -> None:
        """Free the scene's slot."""
        with self._changed:
            self._occupied.discard(scene_id)
            self._changed.notify_all()

    def update_waits(self, scene_id: str) -> bool:
        """Whether an update waits for the scene's slot."""
        return self._updates_waiting[scene_id] > 0
