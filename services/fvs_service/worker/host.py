"""The scenes that one worker holds: their leases, their runners, and the memory that they share."""

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import structlog

from fvs_service.application import Storage
from fvs_service.errors import StaleLeaseError
from fvs_service.scenes.lease import Lease
from fvs_service.scenes.repository import find_scene
from fvs_service.snapshots.repository import find_snapshot
from fvs_service.worker.capacity import MemoryBudget, memory_limit_bytes, warm_need_bytes
from fvs_service.worker.child import RunnerChild
from fvs_service.worker.protocol import RunnerError, RunnerGoneError, YieldQuestion, answer_to, connect

_POLL_S = 0.25
_ASK_S = 2.0
_RETIRE_S = 5.0
_WARM_PATIENCE_S = 60.0
"""Whoever wanted the scene warm has given up by then."""

_log = structlog.get_logger()


@dataclass
class Hosted:
    """A scene that this worker holds, with its runner; ``busy`` while somebody here works with it."""

    lease: Lease
    child: RunnerChild
    busy: int = 0

    @property
    def endpoint(self) -> str:
        """Where the runner answers."""
        return self.child.endpoint


class Host:
    """Holds scenes for jobs and for rankings; safe to use from any thread."""

    def __init__(self, storage: Storage, worker_id: str) -> None:
        self._storage = storage
        self._worker_id = worker_id
        self._budget = MemoryBudget(memory_limit_bytes(storage.settings.worker), self._unload_longest_idle)
        self._spawner = ThreadPoolExecutor(1, thread_name_prefix="spawner")
        self._lock = threading.Lock()
        self._scene_locks: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self._hosted: dict[str, Hosted] = {}
        self._stopping = threading.Event()
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()

    @contextmanager
    def hold(self, scene_id: str, need_bytes: int, give_up: Callable[[], bool]) -> Iterator[Hosted | None]:
        """Have the scene's runner for the block; None when ``give_up`` said so before it was there.

        Waits for memory, and for another worker to yield the scene. Raises ``RunnerGoneError`` when the
        runner does not start.
        """
        hosted = self._take(scene_id, need_bytes, lambda: give_up() or self._stopping.is_set())
        try:
            yield hosted
        finally:
            if hosted is not None:
                self._let_go(hosted)

    @contextmanager
    def leased(self, scene_id: str, give_up: Callable[[], bool]) -> Iterator[Lease | None]:
        """Have the scene's lease without a runner."""
        with self._scene_locks[scene_id]:
            self._drop(self._hosted.get(scene_id))
            lease = self._acquire(scene_id, give_up)
            try:
                yield lease
            finally:
                if lease is not None:
                    self._storage.leases.release(lease)

    def warm(self, scene_id: str) -> None:
        """Start the scene's runner, so that it can answer; no more if it does not start.

        Another worker that holds the scene is left alone: it has a runner, or is starting one.
        """
        until = time.monotonic() + _WARM_PATIENCE_S

        def give_up() -> bool:
            holder = self._storage.leases.holder(scene_id)
            return time.monotonic() > until or (holder is not None and holder.worker_id != self._worker_id)

        try:
            with self.hold(scene_id, self._warm_need(scene_id), give_up):
                pass
        except RunnerGoneError as error:
            _log.warning("runner did not start", scene=scene_id, reason=str(error))

    def drop(self, hosted: Hosted) -> None:
        """End a runner that is of no use any more, and give the scene back."""
        with self._scene_locks[hosted.lease.scene_id]:
            self._drop(hosted)

    def stop(self) -> None:
        """End all runners and give all scenes back."""
        self._stopping.set()
        self._keeper.join()
        held = list(self._hosted.values())
        with ThreadPoolExecutor(max(1, len(held))) as pool:
            list(pool.map(lambda hosted: hosted.child.retire(_RETIRE_S), held))
        for hosted in held:
            self._drop(hosted)

    @property
    def stopping(self) -> bool:
        """Whether the worker is about to end."""
        return self._stopping.is_set()

    def _take(self, scene_id: str, need_bytes: int, give_up: Callable[[], bool]) -> Hosted | None:
        with self._scene_locks[scene_id]:
            hosted = self._hosted.get(scene_id)
            if hosted is not None and hosted.child.alive:
                with self._lock:
                    hosted.busy += 1
                if self._budget.reserve(scene_id, need_bytes, give_up):
                    return hosted
                with self._lock:
                    hosted.busy -= 1
                return None
            self._drop(hosted)
            if not self._budget.reserve(scene_id, need_bytes, give_up):
                return None
            lease = self._acquire(scene_id, give_up)
            if lease is None:
                self._budget.release(scene_id)
                return None
            return self._start(lease)

    def _let_go(self, hosted: Hosted) -> None:
        """One that worked with the scene is done; the last one leaves it what a warm model needs."""
        need = None
        try:
            need = self._warm_need(hosted.lease.scene_id)
        finally:
            with self._lock:
                hosted.busy -= 1
                if hosted.busy == 0 and need is not None:
                    self._budget.shrink(hosted.lease.scene_id, need)

    def _start(self, lease: Lease) -> Hosted:
        keep = _Extender(self._storage, lease)
        try:
            child = RunnerChild(
                lease.scene_id,
                self._storage.settings,
                self._spawner,
                lambda: self._stopping.is_set() or keep.lost(),
            )
        except RunnerGoneError:
            self._budget.release(lease.scene_id)
            self._storage.leases.release(lease)
            raise
        try:
            hosted = Hosted(self._storage.leases.extend(lease, child.endpoint), child, busy=1)
        except StaleLeaseError as error:
            child.kill()
            self._budget.release(lease.scene_id)
            raise RunnerGoneError("Another worker took the scene.") from error
        with self._lock:
            self._hosted[lease.scene_id] = hosted
        return hosted

    def _acquire(self, scene_id: str, give_up: Callable[[], bool]) -> Lease | None:
        while True:
            lease = self._storage.leases.acquire(scene_id, self._worker_id)
            if lease is not None or give_up():
                return lease
            holder = self._storage.leases.holder(scene_id)
            if holder is not None and holder.endpoint is not None:
                _ask_to_yield(holder.endpoint)
            time.sleep(_POLL_S)

    def _drop(self, hosted: Hosted | None) -> None:
        if hosted is None:
            return
        scene_id = hosted.lease.scene_id
        hosted.child.kill()
        with self._lock:
            if self._hosted.get(scene_id) is hosted:
                del self._hosted[scene_id]
                self._budget.release(scene_id)
        self._storage.leases.release(hosted.lease)

    def _keep(self) -> None:
        """Until the worker stops: extend leases, look after children, unload what nobody uses."""
        every_s = self._storage.settings.lease_s / 5
        extended = 0.0
        while not self._stopping.wait(_POLL_S):
            due = time.monotonic() - extended >= every_s
            if due:
                extended = time.monotonic()
            for hosted in list(self._hosted.values()):
                try:
                    self._look_after(hosted, due)
                except Exception:  # the database is away: the leases run out, unless it comes back
                    _log.exception("cannot look after a scene", scene=hosted.lease.scene_id)

    def _look_after(self, hosted: Hosted, due: bool) -> None:
        if not hosted.child.alive:
            if hosted.busy == 0:
                self._drop_if_free(hosted)
        elif due:
            self._extend(hosted)
            if hosted.busy == 0 and hosted.child.idle_s() > self._storage.settings.worker.idle_s:
                self._unload(hosted)

    def _extend(self, hosted: Hosted) -> None:
        try:
            self._storage.leases.extend(hosted.lease)
        except StaleLeaseError:
            _log.warning("lease lost", scene=hosted.lease.scene_id)
            hosted.child.kill()  # whoever works with it sees it gone
        else:
            hosted.child.extend()

    def _unload_longest_idle(self) -> bool:
        free = [hosted for hosted in list(self._hosted.values()) if hosted.busy == 0]
        return any(self._unload(hosted) for hosted in sorted(free, key=lambda one: -one.child.idle_s()))

    def _unload(self, hosted: Hosted) -> bool:
        lock = self._scene_locks[hosted.lease.scene_id]
        if not lock.acquire(blocking=False):
            return False
        try:
            if hosted.busy or not hosted.child.yield_scene():
                return False
            self._drop(hosted)
            return True
        finally:
            lock.release()

    def _drop_if_free(self, hosted: Hosted) -> None:
        lock = self._scene_locks[hosted.lease.scene_id]
        if lock.acquire(blocking=False):
            try:
                self._drop(hosted)
            finally:
                lock.release()

    def _warm_need(self, scene_id: str) -> int:
        with self._storage.database.reading() as session:
            snapshot_id = find_scene(session, scene_id).snapshot_id
            gaussians = 0 if snapshot_id is None else find_snapshot(session, snapshot_id).metrics.gaussians
        return warm_need_bytes(gaussians)


class _Extender:
    """Extends a lease while its runner is still starting."""

    def __init__(self, storage: Storage, lease: Lease) -> None:
        self._storage = storage
        self._lease = lease
        self._extended = time.monotonic()

    def lost(self) -> bool:
        """Extend when it is time; whether somebody else has the lease by now."""
        if time.monotonic() - self._extended < self._storage.settings.lease_s / 5:
            return False
        self._extended = time.monotonic()
        try:
            self._storage.leases.extend(self._lease)
        except StaleLeaseError:
            return True
        return False


def _ask_to_yield(endpoint: str) -> None:
    """Ask another worker's runner to end; it does unless it is working."""
    with suppress(RunnerGoneError, RunnerError):
        line = connect(endpoint, _ASK_S)
        try:
            line.wait_at_most(_ASK_S)
            answer_to(line, YieldQuestion())
        finally:
            line.close()
