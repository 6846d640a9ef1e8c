"""The hosts of all scenes on the cluster, as the dispatcher sees them: it places them, and calls them."""

import contextlib
import importlib.metadata
import math
import os
import threading
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import ray
import structlog
from ray.exceptions import ActorUnavailableError, GetTimeoutError, RayActorError, RayTaskError
from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from fvs_schema.jobs import WaitReason
from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, ServiceError
from fvs_service.host.cluster.connection import (
    ClusterUnavailableError,
    alive_nodes,
    connect,
    origin,
    plain,
)
from fvs_service.host.cluster.resources import Resources, cpus_of, need_of, need_to_rank
from fvs_service.host.cluster.scene_host import HostOpened, HostStatus, SceneHost
from fvs_service.host.worker.deleted_images import unless_locked
from fvs_service.host.worker.hosts import HostsStatus
from fvs_service.host.worker.resources import idle_need_of_scene
from fvs_service.host.worker.starts import Starts
from fvs_service.jobs.states import Turn
from fvs_service.storage.tables import IdentityRow

_TURNS_AT_ONCE = 256
_PATIENCE_S = 3.0
"""How long a turn waits for a place on a node before it goes back into the queue."""
_PLACES = 3
"""A host is placed again where it cannot work: Ray may not know yet that a node is dead."""
_POLL_S = 0.5
_LOOK_S = 1.0
_SILENT_S = 15.0
"""The cluster counts as away when it has not answered for this long."""
_CONNECT_AGAIN_S = 5.0
_LEAVE_S = 5.0
"""How long a host may take to end its runner."""
_CALLS_AT_ONCE = 16
_EXIT_CLUSTER_LOST = 6
_IDLE_S = 5.0
"""A host that was idle for this long makes room for one that waits for a place."""
_WANTED_S = 60.0
"""A host that waits for a place is given up after this time, unless its scene has an open job."""
_DEAF_S = 20.0
"""A host that has answered nothing for this long is killed, and placed again if it has a turn."""
_AVOIDED_S = 60.0
"""For how long no host is placed on a node that cannot work: it lacks the object store, or may be dead."""
_VERSION = importlib.metadata.version("fvs")
_SAME_VERSIONS = "Install the same versions of fvs[ray], Ray and Python on all nodes as on the dispatcher."

_log = structlog.get_logger()


@dataclass(eq=False)
class _Host:
    """A scene's host; ``node_id`` is None while it waits for a place, ``turns`` are run on it now."""

    actor: Any
    resources: Resources
    opened: Any
    """Ray's reference to the result of ``SceneHost.open``."""
    node_id: str | None = None
    turns: int = 0
    wanted: float = field(default_factory=time.monotonic)
    status: HostStatus | None = None
    answered: float = field(default_factory=time.monotonic)
    """When it last answered, or got its place."""

    @property
    def idle_s(self) -> float:
        """How long it has been idle, by its last status."""
        return 0.0 if self.turns or self.status is None else self.status.idle_s


class ClusterHosts:
    """The ``SceneHosts`` on a Ray cluster; all hosts lease their scenes as one worker, ``worker_id``."""

    turns_at_once = _TURNS_AT_ONCE

    def __init__(self, storage: Storage, worker_id: str) -> None:
        self._storage, self._worker_id = storage, worker_id
        self._settings = storage.settings
        with storage.database.reading() as session:
            identity = session.execute(select(IdentityRow.id)).scalar_one()
        self._namespace = f"fvs-{identity}"
        self._lock = threading.Lock()
        self._scene_locks: WeakValueDictionary[str, threading.Lock] = WeakValueDictionary()
        self._hosts: dict[str, _Host] = {}
        self._avoided: dict[str, float] = {}
        self._slots, self._gpus = 0, 0.0
        self._seen = -math.inf
        self._connected = threading.Event()
        self._stopping = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def run(self, turn: Turn) -> WaitReason | None:
        """See ``SceneHosts``. A turn whose host died goes on with another one."""
        self._connected.wait()
        while self._storage.queue.has(turn):
            host = self._placed_for(turn)
            if not isinstance(host, _Host):
                return host
            try:
                obstacle = self._run_on(host, turn)
            except RayActorError as error:
                self._lose(turn.scene_id, host, error)
                if not self._is_alive(host):
                    Starts(self._storage.database, turn).excuse()  # it is not the job's fault
            else:
                if any(other.node_id is None for other in list(self._hosts.values())):
                    self._leave(turn.scene_id, host)
                return obstacle
        return None

    def start_runner(self, scene_id: str) -> None:
        """See ``SceneHosts``."""
        self._connected.wait()
        memory_bytes = idle_need_of_scene(self._storage.database, scene_id)
        host = self._placed(scene_id, need_to_rank(self._settings.worker, memory_bytes))
        if isinstance(host, WaitReason):
            _log.warning("runner not started", scene=scene_id, lacks=host.value)
            return
        try:
            ray.get(host.actor.start_runner.remote())
        except RayActorError as error:
            self._lose(scene_id, host, error)

    @property
    def status(self) -> HostsStatus:
        """See ``SceneHosts``; there are no slots while the cluster is away."""
        known = [host.status for host in list(self._hosts.values()) if host.status is not None]
        return HostsStatus(
            slots=self._slots if time.monotonic() - self._seen < _SILENT_S else 0,
            disk_full=False,
            backend=known[-1].backend if known else self._settings.worker.backend,
            runner_bytes=sum(status.runner_bytes for status in known),
        )

    def without_jobs(self, folder: Path) -> AbstractContextManager[bool]:
        """See ``SceneHosts``; each host does the same on its node."""
        return unless_locked(folder)

    def stop(self) -> None:
        """See ``SceneHosts``. The hosts go on; the next dispatcher finds them."""
        self._stopping.set()

    def _placed_for(self, turn: Turn) -> "_Host | WaitReason | None":
        try:
            with self._storage.database.reading() as session:
                need = need_of(session, turn, self._settings.worker, self._gpus)
        except NotFoundError:
            return None
        return self._placed(turn.scene_id, need)

    def _run_on(self, host: _Host, turn: Turn) -> WaitReason | None:
        with self._lock:
            host.turns += 1
        try:
            obstacle: WaitReason | None = ray.get(host.actor.run.remote(turn))
            return obstacle
        finally:
            with self._lock:
                host.turns -= 1

    def _placed(self, scene_id: str, need: Resources) -> _Host | WaitReason:
        """The scene's host, on a node with what is needed; else what it lacks while it waits for a place."""
        with self._lock_of(scene_id):
            host = self._hosts.get(scene_id)
            if host is not None and not host.resources.cover(need):
                if not self._leave(scene_id, host):
                    return WaitReason.NODE
                host = None
            until = time.monotonic() + _PATIENCE_S
            for _ in range(_PLACES):
                if host is None:
                    host = self._create(scene_id, need)
                host.wanted = time.monotonic()
                while not self._is_placed(host):
                    if time.monotonic() > until:
                        return self._lacks(need)
                    self._make_room(need)
                if self._works(scene_id, host):
                    return host
                host = None
                if self._lacks(need) is WaitReason.CLUSTER:
                    break
            return WaitReason.CLUSTER

    def _create(self, scene_id: str, need: Resources) -> _Host:
        """Have Ray place a new host; one with the same name, which nobody knows here, is killed."""
        options: dict[str, Any] = {
            **need.options,
            "name": scene_id,
            "namespace": self._namespace,
            "lifetime": "detached",
            "max_concurrency": _CALLS_AT_ONCE,
            "label_selector": self._labels(need),
        }
        worker = self._settings.worker
        trains = need.gpus >= (worker.gpus if worker.gpus is not None else self._gpus)
        remote: Any = ray.remote(SceneHost)
        arguments = (scene_id, self._worker_id, self._settings, need)
        with contextlib.suppress(ValueError):  # there is none
            ray.kill(ray.get_actor(scene_id, self._namespace))
        actor = remote.options(**options).remote(*arguments, trains=trains)
        host = _Host(actor, need, actor.open.remote(_VERSION))
        with self._lock:
            self._hosts[scene_id] = host
        return host

    def _labels(self, need: Resources) -> dict[str, str]:
        """The labels of nodes that need not be avoided; all nodes if no other one has what is needed."""
        avoided, fitting = self._avoided_now(), self._fitting(need)
        if not avoided & fitting or fitting <= avoided:
            return {}
        return {"ray.io/node-id": f"!in({','.join(avoided & fitting)})"}

    def _avoided_now(self) -> set[str]:
        now = time.monotonic()
        return {node for node, since in list(self._avoided.items()) if now - since < _AVOIDED_S}

    def _fitting(self, need: Resources) -> set[str]:
        """The nodes that are alive and have what is needed, in use or not."""
        return {node["NodeID"] for node in alive_nodes() if Resources.of_node(node).cover(need)}

    def _is_placed(self, host: _Host) -> bool:
        done, _ = ray.wait([host.opened], timeout=_POLL_S)
        return bool(done)

    def _works(self, scene_id: str, host: _Host) -> bool:
        """Whether a host that has a place can work there."""
        if host.node_id is not None:
            return True
        try:
            opened: HostOpened = ray.get(host.opened)
        except Exception as error:
            if isinstance(error, RayActorError) and not error.actor_init_failed:
                self._lose(scene_id, host, error)
                return False
            address = origin(error)  # where the service is not installed, or has another version
            _log.error(
                "host cannot start", scene=scene_id, address=address, reason=plain(error), hint=_SAME_VERSIONS
            )
            for node in alive_nodes():
                if node["NodeManagerAddress"] == address:
                    self._avoided[node["NodeID"]] = time.monotonic()
            self._forget(scene_id, host)
            return False
        if opened.refusal:
            _log.error("host cannot work on its node", node=opened.node_id, reason=opened.refusal)
            self._avoided[opened.node_id] = time.monotonic()
            self._forget(scene_id, host)
            return False
        host.node_id, host.answered = opened.node_id, time.monotonic()
        _log.info("host placed", scene=scene_id, node=opened.node_id, **host.resources.options)
        return True

    def _lacks(self, need: Resources) -> WaitReason:
        fitting = self._fitting(need)
        if not fitting:
            return WaitReason.NO_NODE
        if fitting <= self._avoided_now():
            return WaitReason.CLUSTER
        return WaitReason.GPU if need.gpus else WaitReason.NODE

    def _make_room(self, need: Resources) -> None:
        """Have the host that was idle for longest give up its place, if any has what is needed."""
        with self._lock:
            idle = [
                (host.idle_s, scene_id, host)
                for scene_id, host in self._hosts.items()
                if host.node_id is not None
                and host.idle_s > _IDLE_S
                and (host.resources.gpus or not need.gpus)
            ]
        if idle:
            _, scene_id, host = max(idle, key=lambda one: one[0])
            self._leave(scene_id, host)

    def _leave(self, scene_id: str, host: _Host) -> bool:
        """Have a host give up its place, unless a turn runs on it; returns whether."""
        if host.turns:
            return False
        if host.node_id is not None:
            try:
                if not ray.get(host.actor.leave.remote(), timeout=_LEAVE_S):
                    return False
            except (RayActorError, GetTimeoutError) as error:
                _log.warning("host lost", scene=scene_id, node=host.node_id, reason=plain(error))
        self._forget(scene_id, host)
        return True

    def _lose(self, scene_id: str, host: _Host, error: RayActorError) -> None:
        """Forget a host that does not answer. Where it cannot be reached, Ray may soon find its node dead."""
        _log.warning("host lost", scene=scene_id, node=host.node_id, reason=plain(error))
        if isinstance(error, ActorUnavailableError) and host.node_id is not None:
            self._avoided[host.node_id] = time.monotonic()
        self._forget(scene_id, host)

    def _is_alive(self, host: _Host) -> bool:
        """Whether the node of a host is alive, as far as is known."""
        return host.node_id not in self._avoided and any(
            node["NodeID"] == host.node_id for node in alive_nodes()
        )

    def _forget(self, scene_id: str, host: _Host) -> None:
        """Kill a host, dead or alive, or withdraw it while it waits for a place."""
        ray.kill(host.actor)
        with self._lock:
            if self._hosts.get(scene_id) is host:
                del self._hosts[scene_id]

    def _watch(self) -> None:
        """Until the worker stops: connect, then look after the nodes and the hosts.

        When the cluster is lost this process ends, and the next one connects again.
        """
        while not self._connect():
            if self._stopping.wait(_CONNECT_AGAIN_S):
                return
        try:
            self._adopt_hosts()
            while True:
                self._look_at_nodes()
                self._connected.set()
                try:
                    self._look_at_hosts()
                except (SQLAlchemyError, ServiceError) as error:
                    _log.warning("database unavailable", reason=type(error).__name__)
                if self._stopping.wait(_LOOK_S):
                    return
        except Exception:
            _log.exception("cluster lost")
            os._exit(_EXIT_CLUSTER_LOST)

    def _connect(self) -> bool:
        assert self._settings.cluster is not None
        try:
            connect(self._settings.cluster, self._namespace)
        except ClusterUnavailableError as error:
            _log.error(error.message, hint=error.hint)
            return False
        _log.info("cluster reached", address=self._settings.cluster)
        return True

    def _adopt_hosts(self) -> None:
        """Take over the hosts of the dispatcher before this one; withdraw those that wait for a place."""
        for scene_id in ray.util.list_named_actors():
            with contextlib.suppress(ValueError):  # it has just ended
                actor: Any = ray.get_actor(scene_id, self._namespace)
                try:
                    resources: Resources = ray.get(actor.resources.remote(), timeout=_LEAVE_S)
                except (RayActorError, GetTimeoutError):
                    ray.kill(actor)
                else:
                    self._hosts[scene_id] = _Host(actor, resources, actor.open.remote(_VERSION))

    def _look_at_nodes(self) -> None:
        nodes = [Resources.of_node(node) for node in alive_nodes()]
        worker = self._settings.worker
        has_gpu = any(node.gpus for node in nodes)
        self._gpus = float(has_gpu) if worker.gpus is None else worker.gpus
        self._slots = max(1, int(sum(node.cpus for node in nodes) / cpus_of(worker)))
        self._seen = time.monotonic()

    def _look_at_hosts(self) -> None:
        hosts = list(self._hosts.items())
        for scene_id, host in hosts:
            if host.node_id is None:
                self._look_at_waiting(scene_id, host)
        asked = {
            host.actor.status.remote(): (scene_id, host)
            for scene_id, host in hosts
            if host.node_id is not None
        }
        answered, _ = ray.wait(list(asked), num_returns=len(asked), timeout=_LOOK_S) if asked else ([], [])
        for reference in answered:
            scene_id, host = asked[reference]
            host.answered = time.monotonic()
            try:
                host.status = ray.get(reference)
            except RayActorError:
                if not host.turns:
                    self._forget(scene_id, host)
            except RayTaskError as error:  # its database is away
                _log.warning("host without status", scene=scene_id, reason=plain(error))
        for scene_id, host in asked.values():
            if time.monotonic() - host.answered > _DEAF_S:  # Ray does not ask whether actors answer
                _log.warning("host killed, it does not answer", scene=scene_id, node=host.node_id)
                self._forget(scene_id, host)  # which ends the turn that runs on it

    def _look_at_waiting(self, scene_id: str, host: _Host) -> None:
        """Let the scene's job have its turn once the host has a place; withdraw one that nobody wants."""
        lock = self._lock_of(scene_id)
        if not lock.acquire(blocking=False):
            return  # a turn waits for it
        try:
            if ray.wait([host.opened], timeout=0)[0]:
                if self._works(scene_id, host) or self._lacks(host.resources) is not WaitReason.CLUSTER:
                    self._storage.queue.try_again(scene_id)
            elif time.monotonic() - host.wanted < _WANTED_S or self._storage.queue.has_open(scene_id):
                self._make_room(host.resources)
            else:
                self._forget(scene_id, host)
        finally:
            lock.release()

    def _lock_of(self, scene_id: str) -> threading.Lock:
        """The scene's lock; it is deleted when no thread holds it."""
        with self._lock:
            return self._scene_locks.setdefault(scene_id, threading.Lock())
