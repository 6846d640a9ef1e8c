"""The hosts of all scenes on the cluster, as the dispatcher sees them: it places them, and calls them.

Their states are in ``placement``. One thread moves them by what they answer; turns wait for theirs.
"""

import contextlib
import importlib.metadata
import math
import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import ray
import structlog
from ray.exceptions import ActorUnavailableError, RayActorError, RayError
from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from fvs_schema.jobs import JobState, WaitReason
from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, ServiceError
from fvs_service.host.cluster.connection import (
    ClusterUnavailableError,
    alive_nodes,
    connect,
    origin,
    plain,
)
from fvs_service.host.cluster.placement import Host, Room, State
from fvs_service.host.cluster.resources import Resources, cpus_of, need_of, need_to_rank
from fvs_service.host.cluster.scene_host import LOOKS, HostOpened, HostStatus, SceneHost
from fvs_service.host.worker.hosts import HostsStatus
from fvs_service.host.worker.resources import idle_need_of_scene
from fvs_service.host.worker.starts import Starts
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.jobs.repository import find_job
from fvs_service.jobs.states import Turn
from fvs_service.storage.tables import IdentityRow

_TURNS_AT_ONCE = 256
_STARTS_AT_ONCE = 64
_PATIENCE_S = 3.0
"""How long a turn waits for a place on a node, or for the cluster, before it goes back into the queue."""
_PLACES = 3
"""A host is placed again where it cannot work: Ray may not know yet that a node is dead."""
_POLL_S = 0.25
_LOOK_S = 1.0
_SILENT_S = 15.0
"""The cluster counts as away when it has not answered for this long."""
_CONNECT_AGAIN_S = 1.0
_EXIT_CLUSTER_LOST = 6
_WANTED_S = 60.0
"""A host that waits for a place is given up after this time, unless its scene has an open job."""
_AVOIDED_S = 60.0
"""For how long no host is placed on a node that cannot work: it lacks the object store, or may be dead."""
_CALLS_AT_ONCE, _LOOKS_AT_ONCE = 16, 2
_VERSION = importlib.metadata.version("fvs")
_SAME_VERSIONS = "Install the same versions of fvs[ray], Ray and Python on all nodes as on the dispatcher."

_log = structlog.get_logger()


class ClusterHosts:
    """The ``SceneHosts`` on a Ray cluster; all hosts lease their scenes as one worker, ``worker_id``."""

    turns_at_once = _TURNS_AT_ONCE
    starts_at_once = _STARTS_AT_ONCE

    def __init__(self, storage: Storage, worker_id: str) -> None:
        self._storage, self._worker_id = storage, worker_id
        self._settings = storage.settings
        with storage.database.reading() as session:
            identity = session.execute(select(IdentityRow.id)).scalar_one()
        self._namespace = f"fvs-{identity}"
        self._changed = threading.Condition()
        """Held to read and change the hosts; notified when one has changed."""
        self._hosts: dict[str, Host] = {}
        self._nodes: dict[str, Resources] = {}
        self._avoided: dict[str, float] = {}
        self._gpus = 0.0
        self._seen = -math.inf
        self._connected = threading.Event()
        self._stopping = threading.Event()
        self._sweeps = Sweeps(storage)
        self._sweeps.start()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    def run(self, turn: Turn) -> WaitReason | None:
        """See ``SceneHosts``. A turn whose host died goes on with another one."""
        while not self._connected.wait(_PATIENCE_S):
            if not self._may_go_on(turn):
                return WaitReason.CLUSTER
        while self._storage.queue.has(turn):
            try:
                with self._storage.database.reading() as session:
                    need = need_of(session, turn, self._settings.worker, self._gpus)
            except NotFoundError:
                return None
            with self._using(turn.scene_id, need, spare=True) as host:
                if not isinstance(host, Host):
                    return host
                try:
                    obstacle: WaitReason | None = ray.get(host.actor.run.remote(turn))
                except RayActorError as error:
                    if not self._lose(host, error):
                        Starts(self._storage.database, turn).excuse()  # it is not the job's fault
                else:
                    return obstacle
        return None

    def start_runner(self, scene_id: str) -> None:
        """See ``SceneHosts``."""
        if not self._connected.wait(_PATIENCE_S):
            return
        memory_bytes = idle_need_of_scene(self._storage.database, scene_id)
        need = need_to_rank(self._settings.worker, memory_bytes, self._gpus)
        with self._using(scene_id, need, spare=False) as host:
            if not isinstance(host, Host):
                _log.warning("runner not started", scene=scene_id, lacks=host.value)
                return
            try:
                ray.get(host.actor.start_runner.remote())
            except RayActorError as error:
                self._lose(host, error)

    @property
    def status(self) -> HostsStatus:
        """See ``SceneHosts``; there are no slots while the cluster is away."""
        known = [host.status for host in list(self._hosts.values()) if host.status is not None]
        cpus = sum(node.cpus for node in list(self._nodes.values()))
        away = time.monotonic() - self._seen > _SILENT_S
        return HostsStatus(
            slots=0 if away else max(1, int(cpus / cpus_of(self._settings.worker))),
            disk_full=False,
            backend=known[-1].backend if known else self._settings.worker.backend,
            runner_bytes=sum(status.runner_bytes for status in known),
        )

    def stop(self) -> None:
        """See ``SceneHosts``. The hosts go on; the next dispatcher finds them."""
        self._sweeps.stop()
        self._stopping.set()

    def _may_go_on(self, turn: Turn) -> bool:
        """Whether the scene may have a host that goes on with the turn while the cluster is away."""
        try:
            with self._storage.database.reading() as session:
                begun = find_job(session, turn.job_id).state is not JobState.QUEUED
        except NotFoundError:
            return False
        return begun and self._storage.leases.holder(turn.scene_id) is not None

    @contextlib.contextmanager
    def _using(self, scene_id: str, need: Resources, *, spare: bool) -> Iterator[Host | WaitReason]:
        """Use the scene's host, which has what is needed; gives what it lacks when it waits for a place.

        ``spare``: the scene may give up its place at once when the block ends.
        """
        with self._changed:
            host = self._claim(scene_id, need)
        try:
            yield host
        finally:
            if isinstance(host, Host):
                with self._changed:
                    host.users -= 1
                    host.idle_s = math.inf if spare else 0.0
                    self._changed.notify_all()

    def _claim(self, scene_id: str, need: Resources) -> Host | WaitReason:
        until = time.monotonic() + _PATIENCE_S
        failures, last = 0, None
        while True:
            host = self._hosts.get(scene_id)
            if last is not None and last is not host and last.failed:
                failures += 1
                if failures == _PLACES or self._lacks(need) is WaitReason.CLUSTER:
                    return WaitReason.CLUSTER
            if host is None:
                host = self._make(scene_id, need)
            last, host.wanted = host, time.monotonic()
            suits = host.resources is None or host.resources.cover(need)
            if not suits and host.users == 0:
                self._dismiss(host)
            elif suits and host.state is State.READY:
                host.users += 1
                host.idle_s = 0.0
                return host
            elif host.state is State.WAITING and time.monotonic() > until:
                return self._lacks(host.resources or need)
            self._changed.wait(_POLL_S)

    def _make(self, scene_id: str, need: Resources) -> Host:
        """Have Ray place a new host, or take over the one that another dispatcher has made meanwhile."""
        try:
            return self._adopt(scene_id)
        except ValueError:  # there is none
            pass
        fitting = Room(self._nodes, ()).fitting(need)
        avoids = self._avoided_now() & fitting
        if avoids == fitting:
            avoids = set()
        options: dict[str, Any] = {
            **need.options,
            "name": scene_id,
            "namespace": self._namespace,
            "lifetime": "detached",
            "max_concurrency": _CALLS_AT_ONCE,
            "label_selector": {"ray.io/node-id": f"!in({','.join(sorted(avoids))})"} if avoids else {},
        }
        remote: Any = ray.remote  # not typed
        actors = remote(concurrency_groups={LOOKS: _LOOKS_AT_ONCE})(SceneHost)
        actor = actors.options(**options).remote(scene_id, self._worker_id, self._settings, need)
        host = Host(scene_id, actor, need, actor.open.remote(_VERSION), frozenset(avoids))
        self._hosts[scene_id] = host
        self._room()
        return host

    def _adopt(self, scene_id: str) -> Host:
        """Take over a host that another dispatcher has made; raises ``ValueError`` if there is none."""
        actor: Any = ray.get_actor(scene_id, self._namespace)
        self._hosts[scene_id] = host = Host(scene_id, actor, None, actor.open.remote(_VERSION))
        return host

    def _dismiss(self, host: Host) -> None:
        """Have a host without users give up its place, or its wait for one."""
        match host.state:
            case State.READY:
                host.ask(State.LEAVING, host.actor.leave.remote())
            case State.STARTING | State.WAITING:
                self._forget(host)

    def _lose(self, host: Host, error: RayActorError) -> bool:
        """Forget a host that has died, or cannot be reached; returns whether its node is alive, as is known.

        A node whose hosts cannot be reached is avoided: Ray may soon find it dead.
        """
        _log.warning("host lost", scene=host.scene_id, node=host.node_id, reason=plain(error))
        with self._changed:
            if isinstance(error, ActorUnavailableError):
                self._avoided[host.node_id] = time.monotonic()
            self._forget(host)
            return host.node_id in self._nodes.keys() - self._avoided_now()

    def _forget(self, host: Host) -> None:
        """Kill a host, dead or alive, or withdraw it while it waits for a place."""
        ray.kill(host.actor)
        host.state, host.asked = State.GONE, None
        if self._hosts.get(host.scene_id) is host:
            del self._hosts[host.scene_id]
        self._changed.notify_all()

    def _lacks(self, need: Resources) -> WaitReason:
        """What a host waits for that needs so much."""
        room = self._room()
        fitting = room.fitting(need)
        if not fitting:
            return WaitReason.NO_NODE
        if fitting <= self._avoided_now():
            return WaitReason.CLUSTER
        return WaitReason.GPU if need.gpus and room.lacks_gpus(need) else WaitReason.NODE

    def _room(self) -> Room:
        return Room(self._nodes, list(self._hosts.values()))

    def _avoided_now(self) -> set[str]:
        now = time.monotonic()
        self._avoided = {node: since for node, since in self._avoided.items() if now - since < _AVOIDED_S}
        return set(self._avoided)

    def _watch(self) -> None:
        """Until the worker stops: connect, then look after the nodes and the hosts.

        When the cluster is lost this process ends, and the next one connects again.
        """
        if not self._connect():
            return
        try:
            for scene_id in ray.util.list_named_actors():
                with contextlib.suppress(ValueError), self._changed:  # it has just ended
                    self._adopt(scene_id)
            looked = -math.inf
            while True:
                if time.monotonic() - looked > _LOOK_S:
                    looked = time.monotonic()
                    self._look_at_nodes()
                    self._look_at_hosts()
                    self._connected.set()
                self._receive()
                with self._changed:
                    victim = self._room().victim()
                    if victim is not None:
                        self._dismiss(victim)
                    all_ready = all(host.state is State.READY for host in self._hosts.values())
                if self._stopping.wait(_LOOK_S if all_ready else _POLL_S):
                    return
        except Exception:
            _log.exception("cluster lost")
            os._exit(_EXIT_CLUSTER_LOST)

    def _connect(self) -> bool:
        """Connect, however long that takes; returns False when the worker stops before."""
        assert self._settings.cluster is not None
        failure = ""
        while not self._stopping.is_set():
            try:
                connect(self._settings.cluster, self._namespace)
            except ClusterUnavailableError as error:
                if error.message != failure:
                    failure = error.message
                    _log.error(failure, hint=error.hint)
                self._stopping.wait(_CONNECT_AGAIN_S)
            else:
                _log.info("cluster reached", address=self._settings.cluster)
                return True
        return False

    def _look_at_nodes(self) -> None:
        self._nodes = {node["NodeID"]: Resources.of_node(node) for node in alive_nodes()}
        gpus = self._settings.worker.gpus
        self._gpus = float(any(node.gpus for node in self._nodes.values())) if gpus is None else gpus
        self._seen = time.monotonic()

    def _look_at_hosts(self) -> None:
        """Ask hosts how they are, kill deaf ones, and withdraw those that wait and that nobody wants."""
        for host in list(self._hosts.values()):
            unwanted = (
                host.state is State.WAITING
                and time.monotonic() - host.wanted > _WANTED_S
                and not self._has_open_job(host.scene_id)
            )
            with self._changed:
                host.unanswered += 1
                if host.deaf:
                    _log.warning("host killed, it does not answer", scene=host.scene_id, node=host.node_id)
                    self._forget(host)  # which ends the turn that runs on it
                elif unwanted:
                    self._dismiss(host)
                elif host.state is State.READY and host.asked is None:
                    host.ask(host.state, host.actor.status.remote())

    def _has_open_job(self, scene_id: str) -> bool:
        try:
            return self._storage.queue.has_open(scene_id)
        except (SQLAlchemyError, ServiceError):
            return True  # as far as is known

    def _receive(self) -> None:
        """Move the hosts that have answered."""
        asked = {host.asked: host for host in list(self._hosts.values()) if host.asked is not None}
        answered, _ = ray.wait(list(asked), num_returns=len(asked), timeout=0) if asked else ([], [])
        for reference in answered:
            host = asked[reference]
            try:
                answer = ray.get(reference)
            except RayError as error:
                answer = error
            with self._changed:
                if host.asked != reference:  # it has been dismissed meanwhile
                    continue
                host.asked, host.unanswered = None, 0
                self._answered(host, answer)
                self._changed.notify_all()
            if isinstance(answer, HostOpened) and not answer.refusal:
                try:
                    self._storage.queue.try_again(host.scene_id)  # its job may have waited for it
                except (SQLAlchemyError, ServiceError) as error:
                    _log.warning("database unavailable", reason=type(error).__name__)

    def _answered(self, host: Host, answer: Any) -> None:
        match answer:
            case HostOpened(refusal=""):
                host.open(answer)
                taken = answer.resources.options
                _log.info("host placed", scene=host.scene_id, node=answer.node_id, **taken)
            case HostOpened():
                _log.error("host cannot work on its node", node=answer.node_id, reason=answer.refusal)
                self._avoided[answer.node_id] = time.monotonic()
                self._fail(host)
            case HostStatus():
                host.status = answer
                host.idle_s = answer.idle_s
            case False:  # it has a user
                host.state, host.idle_s = State.READY, 0.0
            case RayError() if not host.placed:
                self._cannot_start(host, answer)
            case RayError() if host.state is State.READY and host.users:
                pass  # who uses it finds out
            case _:  # it has left, or died
                self._forget(host)

    def _cannot_start(self, host: Host, error: RayError) -> None:
        if isinstance(error, RayActorError) and not error.actor_init_failed:
            self._lose(host, error)
        else:  # the service is not installed there, or has another version
            address = origin(error)
            _log.error(
                "host cannot start",
                scene=host.scene_id,
                address=address,
                reason=plain(error),
                hint=_SAME_VERSIONS,
            )
            for node in alive_nodes():
                if node["NodeManagerAddress"] == address:
                    self._avoided[node["NodeID"]] = time.monotonic()
        self._fail(host)

    def _fail(self, host: Host) -> None:
        host.failed = True
        self._forget(host)
