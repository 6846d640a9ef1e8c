"""The host of a scene: the actor that runs its turns on a node, with the same code as on one machine."""

import contextlib
import importlib.metadata
import math
import os
import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import ray
import structlog

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.private_folder import private_folder
from fvs_engine.files.storage import storage_errors
from fvs_engine.records import Record
from fvs_schema.jobs import WaitReason
from fvs_service.application import open_existing_storage
from fvs_service.errors import ServiceError
from fvs_service.host.cluster.leases import HostLeases
from fvs_service.host.cluster.resources import Resources
from fvs_service.host.worker.hosts import LocalHosts
from fvs_service.ids import new_id
from fvs_service.jobs.states import Turn
from fvs_service.logs import configure_logging
from fvs_service.settings import Settings
from fvs_service.storage.owner import require_own_store
from fvs_service.tracing import Tracing

LOOKS = "looks"
"""The concurrency group of the calls that turns must not delay."""
_LOOK_S = 1.0
_UNUSED_S = 30.0
"""A host without a runner ends after this time."""
_LEFT_S = 60.0
"""A folder without a lock is that of a dead host, unless it is younger than this."""

_log = structlog.get_logger()


class HostOpened(Record):
    """A host's node, what it takes of it, and why it cannot work there ("": it can)."""

    node_id: str
    resources: Resources
    refusal: str = ""


class HostStatus(Record):
    """What a host tells of itself; ``idle_s``: how long it has had neither a job nor a request."""

    idle_s: float
    backend: str
    runner_bytes: int


class SceneHost:
    """Runs the turns of one scene on its node, in a folder of its own that ends with it; a Ray actor.

    A host takes ``resources`` of its node. It ends when it has no runner any longer, when it is asked to, and
    when there is a newer host of its scene.
    """

    def __init__(self, scene_id: str, worker_id: str, settings: Settings, resources: Resources) -> None:
        self._scene_id, self._worker_id = scene_id, worker_id
        self._settings, self._resources = settings, resources
        self._lock = threading.Lock()
        self._held = contextlib.ExitStack()
        self._hosts: LocalHosts | None = None
        self._turns: dict[str, Future[WaitReason | None]] = {}
        self._users = 0
        self._used = time.monotonic()
        self._idle_s = 0.0

    @ray.method(concurrency_group=LOOKS)
    def open(self, version: str) -> HostOpened:
        """Open the database and the object store from this node, for a dispatcher of this ``version``."""
        node_id = ray.get_runtime_context().get_node_id()
        installed = importlib.metadata.version("fvs")
        if installed != version:
            refusal = f"The node has fvs {installed}, the dispatcher {version}. Install the same version."
            return self._is_on(node_id, refusal)
        with self._lock:
            if self._hosts is None:
                configure_logging(machine=True)
                try:
                    self._open()
                except (ServiceError, StorageError) as error:
                    return self._is_on(node_id, f"{error.message} {error.hint}".strip())
        return self._is_on(node_id)

    def run(self, turn: Turn) -> WaitReason | None:
        """Run a turn, or wait for one that runs already: its caller died."""
        with self._in_use() as hosts:
            with self._lock:
                running = self._turns.get(turn.attempt_id)
                ended = self._turns.setdefault(turn.attempt_id, Future())
            if running is None:
                try:
                    ended.set_result(hosts.run(turn))
                except BaseException as error:  # for all callers
                    ended.set_exception(error)
                finally:
                    del self._turns[turn.attempt_id]
            return ended.result()

    def start_runner(self) -> None:
        """Start the scene's runner, so that it can rank."""
        with self._in_use() as hosts:
            hosts.start_runner(self._scene_id)

    @ray.method(concurrency_group=LOOKS)
    def status(self) -> HostStatus:
        """How it was a moment ago; asks no runner."""
        status = self._opened().status
        return HostStatus(
            idle_s=0.0 if self._users else self._idle_s,
            backend=status.backend,
            runner_bytes=status.runner_bytes,
        )

    @ray.method(concurrency_group=LOOKS)
    def leave(self) -> bool:
        """Give the scene up and end this process; returns False while a turn runs or its runner starts."""
        return self._leave()

    def _open(self) -> None:
        root = self._held.enter_context(_own_root())
        worker = self._settings.worker.model_copy(update={"threads": int(self._resources.cpus)})
        settings = self._settings.model_copy(update={"root": root, "worker": worker})
        tracing = Tracing.of_environment("fvs-host")
        storage = self._held.enter_context(open_existing_storage(settings, tracing=tracing))
        storage.blobs.check()
        require_own_store(storage.database, storage.blobs)
        leases = HostLeases(storage.database, settings.lease_s, self._scene_id, self._replaced)
        storage = replace(storage, leases=leases)
        address_of_node: Any = ray.util.get_node_ip_address  # not typed
        trains = self._resources.trains
        self._hosts = LocalHosts(storage, self._worker_id, address_of_node(), trains=trains)
        threading.Thread(target=self._look_at_runner, daemon=True).start()

    def _opened(self) -> LocalHosts:
        assert self._hosts is not None
        return self._hosts

    @contextlib.contextmanager
    def _in_use(self) -> Iterator[LocalHosts]:
        with self._lock:
            self._users += 1
        try:
            yield self._opened()
        finally:
            with self._lock:
                self._users -= 1
            self._used, self._idle_s = time.monotonic(), 0.0

    def _look_at_runner(self) -> None:
        """Find out how long the host has been idle, and end it when it has had no runner for a while."""
        while True:
            time.sleep(_LOOK_S)
            if self._users:
                continue
            runner_idle_s = self._opened().idle_s()
            unused_s = time.monotonic() - self._used
            self._idle_s = min(unused_s, runner_idle_s)
            if runner_idle_s == math.inf and unused_s > _UNUSED_S:
                self._leave()

    def _leave(self) -> bool:
        with self._lock:
            if self._users:
                return False
            self._users += 1  # for ever
        try:
            self._opened().stop()
        finally:  # without the database the lease runs out, or the next host takes it
            self._end()

    def _is_on(self, node_id: str, refusal: str = "") -> HostOpened:
        return HostOpened(node_id=node_id, resources=self._resources, refusal=refusal)

    def _replaced(self) -> NoReturn:
        _log.warning("lease lost: the scene has another host, or was deleted", scene=self._scene_id)
        self._end()  # at once, and its runner with it

    def _end(self) -> NoReturn:
        shutil.rmtree(self._opened().folder, ignore_errors=True)
        os._exit(0)


@contextlib.contextmanager
def _own_root() -> Iterator[Path]:
    """A new folder in this node's ``FVS_ROOT``, locked; those of dead hosts are removed."""
    root = os.environ.get("FVS_ROOT")
    hosts = (private_folder("fvs-node") if root is None else Path(root)) / "hosts"
    with storage_errors(hosts):
        hosts.mkdir(parents=True, exist_ok=True)
    for other in hosts.iterdir():
        with contextlib.suppress(OutputExistsError, StorageError, OSError):
            if time.time() - other.stat().st_mtime > _LEFT_S:
                with locked_folder(other):
                    shutil.rmtree(other, ignore_errors=True)
    own = hosts / new_id("hst")
    own.mkdir()
    with locked_folder(own):
        yield own
