"""What a worker divides among its jobs: memory, and room on the disk. Jobs that do not fit wait."""

import os
import threading
import time
from collections.abc import Callable

from fvs_engine.images.pixels import reduced_size
from fvs_engine.splat.settings import memory_need_bytes
from fvs_schema.images import Image
from fvs_schema.jobs import JobKind, JobRequest
from fvs_service.errors import NotFoundError
from fvs_service.scenes.repository import find_scene_head
from fvs_service.settings import Settings, WorkerSettings
from fvs_service.snapshots.repository import find_snapshot
from fvs_service.storage.blobs import free_bytes
from fvs_service.storage.database import Database

PROGRAM_BYTES = 700_000_000
"""A runner without a model: the interpreter, torch and Numba, and the SfM child. Measured on a
simulated scene of 11 images at 160 px: peaks of 570 MB and 110 MB."""
_DECODING_BYTES = 700_000_000
"""A video's decoder with its process: 0.5 GB for 4K with 10 bits for each colour."""
_IDLE_GAUSSIAN_BYTES = 2 * 4 * 59
_SHARE = 0.75
_POLL_S = 0.25
START_BYTES = 100_000_000
"""Free disk space, beyond the reserve, that a job needs to start."""
_LOOK_EVERY_S = 0.5


def memory_limit_bytes(settings: WorkerSettings) -> int:
    """The memory that all scenes of one worker share."""
    if settings.memory_bytes is not None:
        return settings.memory_bytes
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return round(_SHARE * machine / settings.count)


def job_need_bytes(request: JobRequest, images: tuple[Image, ...], settings: WorkerSettings) -> int:
    """An estimate of the most memory that a job needs, its runner included."""
    if request.kind is JobKind.FRAMES:
        return PROGRAM_BYTES + _DECODING_BYTES
    side = request.long_side_px or settings.long_side_px
    sizes = [reduced_size(image.width_px or side, image.height_px or side, side) for image in images]
    width, height = max(sizes, key=lambda size: size[0] * size[1], default=(side, side))
    fine = request.kind is JobKind.FINE
    gaussians = settings.fine_max_gaussians if fine else settings.max_gaussians
    training = memory_need_bytes(gaussians, 3 if fine else 0, len(images), width, height)
    return PROGRAM_BYTES + training


def idle_need_bytes(gaussians: int) -> int:
    """The memory of a runner that only ranks, with a model of ``gaussians`` Gaussians."""
    return PROGRAM_BYTES + gaussians * _IDLE_GAUSSIAN_BYTES


def idle_need_of_scene(database: Database, scene_id: str) -> int:
    """The memory of a runner that only ranks with the scene's newest model; 0 for a deleted scene."""
    try:
        with database.reading() as session:
            snapshot_id = find_scene_head(session, scene_id).snapshot_id
            gaussians = 0 if snapshot_id is None else find_snapshot(session, snapshot_id).metrics.gaussians
    except NotFoundError:
        return 0
    return idle_need_bytes(gaussians)


class MemoryBudget:
    """Divides a limit among scenes; a scene that needs more than the limit runs alone."""

    def __init__(self, limit_bytes: int, make_room: Callable[[], bool]) -> None:
        """``make_room`` releases a scene that is not in use; it returns whether there was one."""
        self._limit_bytes = limit_bytes
        self._make_room = make_room
        self._changed = threading.Condition()
        self._reserved: dict[str, int] = {}

    def reserve(self, scene_id: str, need_bytes: int, give_up: Callable[[], bool]) -> bool:
        """Wait until the scene has reserved ``need_bytes``, or its present reservation if that is larger.

        Returns False when ``give_up`` returned True first.
        """
        while True:
            with self._changed:
                need = max(need_bytes, self._reserved.get(scene_id, 0))
                others = sum(size for name, size in self._reserved.items() if name != scene_id)
                if others == 0 or others + need <= self._limit_bytes:
                    self._reserved[scene_id] = need
                    return True
            if self._make_room():
                continue
            if give_up():
                return False
            with self._changed:
                self._changed.wait(_POLL_S)

    def shrink(self, scene_id: str, need_bytes: int) -> None:
        """Reduce the scene's reservation to ``need_bytes``."""
        with self._changed:
            if scene_id in self._reserved:
                self._reserved[scene_id] = min(need_bytes, self._reserved[scene_id])
                self._changed.notify_all()

    def release(self, scene_id: str) -> None:
        """Free the scene's reservation."""
        with self._changed:
            self._reserved.pop(scene_id, None)
            self._changed.notify_all()


class Room:
    """Whether jobs may start and continue: the disk of the service's folder has more than its reserve left.

    The reserve is what the database, and the checkpoint of a job that stops, are written into. A job starts
    only with some room more, so that it does not stop at once.
    """

    def __init__(self, settings: Settings) -> None:
        self._folder = settings.root
        self._reserve_bytes = settings.reserve_bytes
        self._start_bytes = settings.reserve_bytes + START_BYTES
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
