"""The scenes that one worker has leased: their leases, their runners, and the memory that they share."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakValueDictionary

import structlog

from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, StaleLeaseError
from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError, call
from fvs_service.host.protocol.messages import YieldScene
from fvs_service.host.worker.deleted_images import unless_locked
from fvs_service.host.worker.resources import MemoryBudget, idle_need_of_scene, memory_limit_bytes
from fvs_service.host.worker.runner_child import RunnerChild
from fvs_service.scenes.lease import Lease

_POLL_S = 0.25
_MAINTAIN_S = 1.0
_EXTENSIONS = 3
"""Number of times that a lease is extended in its duration."""
_YIELD_S = 2.0
_UNANSWERED = 3
"""A runner is killed that has not answered so many pings in a row."""
_RETIRE_S = 2.0
"""How long a runner may take to save its checkpoint; the supervisor's patience is longer than this."""
_START_PATIENCE_S = 60.0
"""The request that needed the runner has failed by then."""

_log = structlog.get_logger()


class NoMemoryError(Exception):
    """The memory of the worker is in use by other scenes."""


@dataclass
class LeasedScene:
    """A scene that this worker has leased, with its runner.

    ``users`` counts the blocks that use it; from ``ping_from`` on its runner is asked whether it is idle;
    ``unanswered`` counts the times in a row that it did not respond to that.
    """

    lease: Lease
    child: RunnerChild
    users: int = 0
    ping_from: float = 0.0
    unanswered: int = 0

    @property
    def endpoint(self) -> str:
        """The address of the runner."""
        return self.child.endpoint


class LeasedScenes:
    """Leases scenes for jobs and for rankings; safe to use from any thread.

    Their runners listen at ``address``, a host name or IP address of this machine.
    """

    def __init__(self, storage: Storage, worker_id: str, address: str = "127.0.0.1") -> None:
        self._storage = storage
        self._worker_id = worker_id
        self._address = address
        self._budget = MemoryBudget(memory_limit_bytes(storage.settings.worker), self._unload_longest_idle)
        self._spawner = ThreadPoolExecutor(1, thread_name_prefix="spawner")
        self._lock = threading.Lock()
        self._scene_locks: WeakValueDictionary[str, threading.Lock] = WeakValueDictionary()
        self._scenes: dict[str, LeasedScene] = {}
        self.backend = storage.settings.worker.backend
        """The rasteriser: the one in the settings until the first runner reports which it uses."""
        self._stopping = threading.Event()
        self._maintenance = threading.Thread(target=self._run_maintenance, daemon=True)
        self._maintenance.start()

    @contextmanager
    def with_runner(
        self,
        scene_id: str,
        need_bytes: int,
        give_up: Callable[[], bool],
        memory_patience_s: float = math.inf,
    ) -> Iterator[LeasedScene | None]:
        """Lease the scene with its runner during the block; yields None when ``give_up`` returns True.

        Waits for memory, and for another worker to yield the scene. Raises ``NoMemoryError`` when that much
        memory is in use for longer than ``memory_patience_s``, ``RunnerGoneError`` when the runner does not
        start.
        """
        memory_until = time.monotonic() + memory_patience_s
        scene = self._take(scene_id, need_bytes, lambda: give_up() or self._stopping.is_set(), memory_until)
        try:
            yield scene
        finally:
            if scene is not None:
                self._end_use(scene)

    @contextmanager
    def without_runner(self, scene_id: str, give_up: Callable[[], bool]) -> Iterator[Lease | None]:
        """Lease the scene during the block, without a runner; yields None when ``give_up`` returns True."""
        with self._lock_of(scene_id):
            self._drop(self._scenes.get(scene_id))
            lease = self._acquire(scene_id, give_up)
            try:
                yield lease
            finally:
                if lease is not None:
                    self._storage.leases.release(lease)

    @contextmanager
    def without_jobs(self, folder: Path) -> Iterator[bool]:
        """Keep jobs away from a scene's ``folder`` during the block; yields False when one may use it.

        An idle runner of this worker, which has the folder locked, forgets its images and still ranks.
        """
        lock = self._lock_of(folder.name)
        if not lock.acquire(blocking=False):
            yield False
            return
        try:
            scene = self._scenes.get(folder.name)
            if scene is not None and scene.child.alive:
                yield scene.users == 0 and scene.child.forget_images()
            else:
                with unless_locked(folder) as free:
                    yield free
        finally:
            lock.release()

    def start_runner(self, scene_id: str) -> None:
        """Start the scene's runner, so that it can rank; a failure is only logged.

        Does nothing when another worker has the lease: it has a runner, or is starting one.
        """
        until = time.monotonic() + _START_PATIENCE_S

        def give_up() -> bool:
            holder = self._storage.leases.holder(scene_id)
            return time.monotonic() > until or (holder is not None and holder.worker_id != self._worker_id)

        try:
            need = idle_need_of_scene(self._storage.database, scene_id)
            with self.with_runner(scene_id, need, give_up):
                pass
        except (RunnerGoneError, NotFoundError) as error:
            _log.warning("runner did not start", scene=scene_id, reason=str(error))

    def drop(self, scene: LeasedScene) -> None:
        """Kill the scene's runner and release the lease."""
        with self._lock_of(scene.lease.scene_id):
            self._drop(scene)

    def stop(self) -> None:
        """End all runners and release all leases."""
        self._stopping.set()
        self._maintenance.join(_POLL_S)  # it may be waiting for the database
        scenes = list(self._scenes.values())
        with ThreadPoolExecutor(max(1, len(scenes))) as pool:
            list(pool.map(lambda scene: scene.child.retire(_RETIRE_S), scenes))
        for scene in scenes:
            self._drop(scene)

    def idle_s(self) -> float:
        """How long all runners have been idle; 0 while one is not, infinite without any."""
        return min((scene.child.idle_s() or 0.0 for scene in list(self._scenes.values())), default=math.inf)

    @property
    def resident_bytes(self) -> int:
        """The resident memory of all runners."""
        return sum(scene.child.resident_bytes for scene in list(self._scenes.values()))

    @property
    def stopping(self) -> bool:
        """Whether the worker is about to end."""
        return self._stopping.is_set()

    def _take(
        self, scene_id: str, need_bytes: int, give_up: Callable[[], bool], memory_until: float
    ) -> LeasedScene | None:
        def late() -> bool:
            return time.monotonic() > memory_until

        def reserve() -> bool:
            if self._budget.reserve(scene_id, need_bytes, lambda: give_up() or late()):
                return True
            if not give_up():
                raise NoMemoryError
            return False

        with self._lock_of(scene_id):
            scene = self._scenes.get(scene_id)
            if scene is not None and scene.child.alive:
                with self._lock:
                    scene.users += 1
                reserved = False
                try:
                    reserved = reserve()
                finally:
                    if not reserved:
                        with self._lock:
                            scene.users -= 1
                return scene if reserved else None
            self._drop(scene)
            if not reserve():
                return None
            scene = None
            try:
                lease = None
                with suppress(NotFoundError):  # the scene was deleted
                    lease = self._acquire(scene_id, give_up)
                if lease is not None:
                    scene = self._start(lease)
                return scene
            finally:
                if scene is None:
                    self._budget.release(scene_id)

    def _end_use(self, scene: LeasedScene) -> None:
        """End one use of the scene; after the last one it keeps only the memory of an idle runner."""
        need = None
        try:
            need = idle_need_of_scene(self._storage.database, scene.lease.scene_id)
        finally:
            with self._lock:
                scene.users -= 1
                if scene.users == 0 and need is not None:
                    self._budget.shrink(scene.lease.scene_id, need)

    def _start(self, lease: Lease) -> LeasedScene:
        starting = _StartingLease(self._storage, lease)
        try:
            child = RunnerChild(
                lease.scene_id,
                self._storage.settings,
                self._spawner,
                lambda: self._stopping.is_set() or starting.lost(),
                self._address,
            )
        except RunnerGoneError:
            self._storage.leases.release(lease)
            raise
        try:
            scene = LeasedScene(self._storage.leases.extend(lease, child.endpoint), child, users=1)
        except BaseException as error:
            child.kill()
            if isinstance(error, StaleLeaseError):
                raise RunnerGoneError("Another worker took the scene.") from error
            raise
        with self._lock:
            self._scenes[lease.scene_id] = scene
            self.backend = child.backend
        return scene

    def _acquire(self, scene_id: str, give_up: Callable[[], bool]) -> Lease | None:
        while True:
            lease = self._storage.leases.acquire(scene_id, self._worker_id)
            if lease is not None or give_up():
                return lease
            holder = self._storage.leases.holder(scene_id)
            if holder is not None and holder.endpoint is not None:
                _request_yield(holder.endpoint)
            time.sleep(_POLL_S)

    def _drop(self, scene: LeasedScene | None) -> None:
        if scene is None:
            return
        scene_id = scene.lease.scene_id
        scene.child.kill()
        with self._lock:
            if self._scenes.get(scene_id) is scene:
                del self._scenes[scene_id]
                self._budget.release(scene_id)
        self._storage.leases.release(scene.lease)

    def _run_maintenance(self) -> None:
        """Until the worker stops: extend leases, drop dead runners, unload idle ones."""
        every_s = self._storage.settings.lease_s / _EXTENSIONS
        extended = 0.0
        while not self._stopping.wait(min(_MAINTAIN_S, every_s)):
            due = time.monotonic() - extended >= every_s
            if due:
                extended = time.monotonic()
            for scene in list(self._scenes.values()):
                try:
                    self._maintain(scene, due)
                except Exception:  # without the database the leases run out
                    _log.exception("cannot maintain a lease", scene=scene.lease.scene_id)

    def _maintain(self, scene: LeasedScene, due: bool) -> None:
        if not scene.child.alive:
            if scene.users == 0:
                self._drop_if_free(scene)
        elif due:
            self._extend(scene)
            if time.monotonic() >= scene.ping_from:
                self._ping(scene)

    def _ping(self, scene: LeasedScene) -> None:
        """Unload the scene when it has been idle for too long; kill a runner that no longer answers."""
        settings = self._storage.settings
        idle_s = scene.child.idle_s()
        scene.unanswered = scene.unanswered + 1 if idle_s is None else 0
        left_s = settings.worker.idle_s - (idle_s or 0.0)
        scene.ping_from = time.monotonic() + min(settings.lease_s, max(0.0, left_s))
        if scene.unanswered >= _UNANSWERED:
            _log.warning("runner killed, it does not answer", scene=scene.lease.scene_id)
            scene.child.kill()  # which ends the job that uses it
        elif left_s < 0 and scene.users == 0:
            self._unload(scene)

    def _extend(self, scene: LeasedScene) -> None:
        try:
            self._storage.leases.extend(scene.lease)
        except StaleLeaseError:
            _log.warning("lease lost", scene=scene.lease.scene_id)
            scene.child.kill()  # which ends the job that uses it
        else:
            scene.child.extend()

    def _unload_longest_idle(self) -> bool:
        free = [scene for scene in list(self._scenes.values()) if scene.users == 0]
        return any(
            self._unload(scene) for scene in sorted(free, key=lambda one: -(one.child.idle_s() or 0.0))
        )

    def _unload(self, scene: LeasedScene) -> bool:
        lock = self._lock_of(scene.lease.scene_id)
        if not lock.acquire(blocking=False):
            return False
        try:
            if scene.users or not scene.child.yield_scene():
                return False
            self._drop(scene)
            return True
        finally:
            lock.release()

    def _drop_if_free(self, scene: LeasedScene) -> None:
        lock = self._lock_of(scene.lease.scene_id)
        if lock.acquire(blocking=False):
            try:
                self._drop(scene)
            finally:
                lock.release()

    def _lock_of(self, scene_id: str) -> threading.Lock:
        """The scene's lock; it is deleted when no thread holds it."""
        with self._lock:
            return self._scene_locks.setdefault(scene_id, threading.Lock())


class _StartingLease:
    """A lease that is extended while its runner starts."""

    def __init__(self, storage: Storage, lease: Lease) -> None:
        self._storage = storage
        self._lease = lease
        self._extended = time.monotonic()

    def lost(self) -> bool:
        """Extend the lease when that is due; returns whether another worker has taken it."""
        if time.monotonic() - self._extended < self._storage.settings.lease_s / _EXTENSIONS:
            return False
        self._extended = time.monotonic()
        try:
            self._storage.leases.extend(self._lease)
        except StaleLeaseError:
            return True
        return False


def _request_yield(endpoint: str) -> None:
    """Ask another worker's runner to end; where a job runs, that worker gives up the scene."""
    with suppress(RunnerGoneError, RunnerError):
        call(endpoint, YieldScene(), _YIELD_S)
