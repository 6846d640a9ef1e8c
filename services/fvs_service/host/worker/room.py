"""Room on the disks that jobs write to."""

import time

from fvs_service.settings import Settings
from fvs_service.storage.blobs import free_bytes

_LOOK_EVERY_S = 0.5


class Room:
    """Whether jobs may start and continue: the disk of the service's folder has more than its reserve left.

    The reserve is what the database, and the checkpoint of a job that stops, are written into. A job starts
    only with some room more, so that it does not stop at once.
    """

    def __init__(self, settings: Settings) -> None:
        self._folder = settings.root
        self._reserve_bytes = settings.reserve_bytes
        self._start_bytes = settings.reserve_bytes + settings.worker.start_bytes
        self._looked = float("-inf")
        self._free_bytes = 0

    @property
    def short(self) -> bool:
        """Whether there is too little room to start a job."""
        return self._free() < self._start_bytes

    @property
    def used_up(self) -> bool:
        """Whether jobs have come to the reserve and must stop."""
        return self._free() < self._reserve_bytes

    def _free(self) -> int:
        if time.monotonic() - self._looked > _LOOK_EVERY_S:
            self._looked = time.monotonic()
            self._free_bytes = free_bytes(self._folder)
        return self._free_bytes
