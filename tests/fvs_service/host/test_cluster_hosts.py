"""The dispatcher's hosts on a cluster that a test makes: who has a place, who makes room, and who is lost."""

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from fake_ray import FakeActor, FakeRay
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.cluster import connection, hosts, placement, scene_host
from fvs_service.host.cluster.hosts import ClusterHosts
from fvs_service.host.cluster.placement import State
from fvs_service.host.cluster.resources import Resources
from fvs_service.host.cluster.scene_host import SceneHost
from fvs_service.host.worker.starts import Starts
from fvs_service.jobs.states import Move, Mover, Turn, move
from fvs_service.settings import Settings, WorkerSettings
from fvs_service.storage.tables import JobRow

from fvs_schema.jobs import WaitReason

_WITHIN_S = 20.0
_GIB = 1 << 30
_SMALL: dict[str, Any] = {"threads": 1, "max_gaussians": 1_000}
_QUICK = {"_LOOK_S": 0.01, "_POLL_S": 0.01, "_PATIENCE_S": 0.3}


def _until(holds: Callable[[], Any]) -> None:
    until = time.monotonic() + _WITHIN_S
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.005)


class Dispatcher:
    """Turns and rankings that run on the hosts of a cluster, each in a thread."""

    def __init__(self, ray: FakeRay, clustered: ClusterHosts, gateway: Any) -> None:
        self.ray, self.hosts, self._gateway = ray, clustered, gateway
        self._threads: list[threading.Thread] = []

    def taken(self) -> Turn:
        return self._gateway.take(self._gateway.queue(self._gateway.scene()), "cluster")

    def turn(self) -> tuple[Turn, "Future[WaitReason | None]"]:
        turn = self.taken()
        return turn, self.run(turn)

    def run(self, turn: Turn) -> "Future[WaitReason | None]":
        ends: Future[WaitReason | None] = Future()
        self._threads.append(threading.Thread(target=lambda: ends.set_result(self.hosts.run(turn))))
        self._threads[-1].start()
        return ends

    def stop(self) -> None:
        """End all turns where they are."""
        self.hosts.stop()
        self.hosts._watcher.join()
        self.hosts._connected.set()
        for actor in (*self.ray.made, *self.ray.actors.values()):
            actor.end_turn()
        while any(thread.is_alive() for thread in self._threads):
            with self.hosts._changed:
                for host in self.hosts._hosts.values():
                    host.state = State.WAITING
                self.hosts._changed.notify_all()
            self._threads[0].join(0.01)

    def actor(self, scene_id: str, number: int = 0) -> FakeActor:
        """The scene's host, the ``number``-th one that was made for it."""
        _until(lambda: sum(made.name == scene_id for made in self.ray.made) > number)
        return [made for made in self.ray.made if made.name == scene_id][number]

    def runs(self, node: str) -> FakeActor:
        """A scene whose turn runs on a node."""
        turn, _ = self.turn()
        actor = self.actor(turn.scene_id)
        actor.place(node)
        _until(lambda: actor.calls["run"])
        return actor

    def idle(self, node: str) -> FakeActor:
        """A scene whose turn has ended on a node, idle for long since."""
        actor = self.runs(node)
        actor.idle_s = 100.0
        actor.end_turn()
        return actor


@pytest.fixture
def dispatching(open_gateway: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Dispatcher]]:
    """Start a dispatcher on a cluster; ``worker``: settings."""
    for name, value in _QUICK.items():
        monkeypatch.setattr(hosts, name, value)
    for name in ("_DEAF", "_DEAF_UNKNOWN"):
        monkeypatch.setattr(placement, name, 5)
    started: list[Dispatcher] = []
    gateways: list[Any] = []

    def start(ray: FakeRay, *, reached: bool = True, **worker: Any) -> Dispatcher:
        if not gateways:
            gateways.append(open_gateway(worker=WorkerSettings(**{**_SMALL, **worker})))
        monkeypatch.setattr(hosts, "ray", ray)
        monkeypatch.setattr(connection, "ray", ray)
        monkeypatch.setattr(ClusterHosts, "_connect", lambda _self: reached)
        clustered = ClusterHosts(gateways[0].application.storage, "cluster")
        started.append(Dispatcher(ray, clustered, gateways[0]))
        return started[-1]

    yield start
    for dispatcher in started:
        dispatcher.stop()


def test_an_idle_host_stays_while_there_is_room_elsewhere(dispatching: Callable[..., Dispatcher]) -> None:
    dispatcher = dispatching(FakeRay(one=(1, 0, 4), two=(1, 0, 4)))
    idle = dispatcher.idle("one")
    turn, ends = dispatcher.turn()
    starting = dispatcher.actor(turn.scene_id)
    time.sleep(3 * _QUICK["_PATIENCE_S"])  # a host takes a while to start
    assert not ends.done()
    starting.place("two")
    _until(lambda: starting.calls["run"])
    assert not idle.dead


def test_the_host_that_was_idle_for_longest_makes_room_for_a_turn(
    dispatching: Callable[..., Dispatcher],
) -> None:
    dispatcher = dispatching(FakeRay(one=(3, 0, 8)))
    busy, short, long = dispatcher.runs("one"), dispatcher.idle("one"), dispatcher.idle("one")
    long.idle_s = 200.0
    _until(lambda: dispatcher.hosts._hosts[long.name].idle_s == 200.0)
    _until(lambda: dispatcher.hosts._hosts[short.name].idle_s == 100.0)
    turn, _ = dispatcher.turn()
    waiting = dispatcher.actor(turn.scene_id)
    _until(lambda: long.dead)
    waiting.place("one")
    _until(lambda: waiting.calls["run"])
    assert not busy.dead
    assert not short.dead


def test_a_job_that_no_node_could_run_takes_no_place_from_others(
    dispatching: Callable[..., Dispatcher],
) -> None:
    ray = FakeRay(one=(2, 0, 1))
    idle = ray.make("scn_idle", Resources(1, 0, _GIB))
    idle.place("one")
    idle.idle_s = 100.0
    dispatcher = dispatching(ray, max_gaussians=30_000_000)
    _, ends = dispatcher.turn()
    assert ends.result(_WITHIN_S) is WaitReason.NO_NODE
    time.sleep(0.1)
    assert not idle.dead


@pytest.mark.parametrize(
    ("node", "busy", "lacks"),
    [
        ((4, 1, 8), Resources(1, 1, _GIB), WaitReason.GPU),
        ((4, 1, 8), Resources(1, 0, 8 * _GIB), WaitReason.NODE),
        ((4, 1, 8), Resources(4, 0, _GIB), WaitReason.NODE),
    ],
)
def test_a_turn_without_a_place_says_what_is_short(
    node: tuple[float, float, int],
    busy: Resources,
    lacks: WaitReason,
    dispatching: Callable[..., Dispatcher],
) -> None:
    ray = FakeRay(one=node)
    ray.make("scn_busy", busy).place("one")
    dispatcher = dispatching(ray)
    _, ends = dispatcher.turn()
    assert ends.result(_WITHIN_S) is lacks


def test_a_host_that_does_not_train_is_replaced_when_the_last_gpu_is_gone(
    dispatching: Callable[..., Dispatcher],
) -> None:
    """Else it would leave the training to another host, again and again."""
    ray = FakeRay(cpu=(4, 0, 8), gpu=(4, 1, 8))
    ray.alive["gpu"] = False
    dispatcher = dispatching(ray)
    turn = dispatcher.taken()
    left = ray.make(turn.scene_id, Resources(1, 0, 4 * _GIB, trains=False))
    left.place("cpu")
    dispatcher.run(turn)
    trains = dispatcher.actor(turn.scene_id, 1)
    assert left.dead
    assert trains.need.trains
    assert not trains.need.gpus


def test_a_host_that_another_dispatcher_has_made_meanwhile_is_not_killed(
    dispatching: Callable[..., Dispatcher],
) -> None:
    ray = FakeRay(one=(4, 0, 8))
    dispatcher = dispatching(ray)
    turn, _ = dispatcher.turn()
    first = dispatcher.actor(turn.scene_id)
    first.place("one")
    _until(lambda: first.calls["run"])
    others = FakeActor(ray, turn.scene_id, first.need, {})
    others.place("one")
    first.die()
    ray.actors[turn.scene_id] = others
    _until(lambda: others.calls["run"])
    assert not others.dead
    assert ray.made == [first]


def test_the_next_dispatcher_takes_over_hosts_and_withdraws_those_without_a_place(
    dispatching: Callable[..., Dispatcher],
) -> None:
    ray = FakeRay(one=(4, 0, 8))
    first = dispatching(ray)
    running = first.runs("one")
    waiting = [ray.make(f"scn_{number}", Resources(1, 0, _GIB)) for number in range(50)]
    began = time.monotonic()
    second = dispatching(ray)
    _until(lambda: second.hosts.status.slots)
    _until(lambda: all(actor.dead for actor in waiting))
    assert time.monotonic() - began < 10
    assert not running.dead


def test_the_loss_of_a_node_is_not_the_jobs_fault_and_that_of_a_host_is(
    dispatching: Callable[..., Dispatcher],
) -> None:
    ray = FakeRay(one=(4, 0, 8), two=(4, 0, 8))
    dispatcher = dispatching(ray)
    turn, _ = dispatcher.turn()
    starts = lambda: Starts(dispatcher.hosts._storage.database, turn)  # noqa: E731
    for number, (node, lose, count) in enumerate(
        (("one", FakeActor.die, 1), ("one", lambda actor: ray.lose(actor.node), 1), ("two", FakeActor.die, 2))
    ):
        actor = dispatcher.actor(turn.scene_id, number)
        actor.place(node)
        _until(lambda actor=actor: actor.calls["run"])
        starts().begin(0.0)  # as the host does
        lose(actor)
        dispatcher.actor(turn.scene_id, number + 1)
        assert starts().without_progress(0.0) == count


def test_nodes_that_cannot_work_are_avoided_for_a_while(
    dispatching: Callable[..., Dispatcher], monkeypatch: pytest.MonkeyPatch
) -> None:
    dispatcher = dispatching(FakeRay(one=(4, 0, 8), two=(4, 0, 8)))
    turn, ends = dispatcher.turn()
    dispatcher.actor(turn.scene_id).place("one", refusal="The store cannot be reached.")
    second = dispatcher.actor(turn.scene_id, 1)
    assert second.options["label_selector"] == {"ray.io/node-id": "!in(one)"}
    second.place("two", refusal="The store cannot be reached.")
    assert ends.result(_WITHIN_S) is WaitReason.CLUSTER
    monkeypatch.setattr(hosts, "_AVOIDED_S", 0.0)
    dispatcher.run(turn)
    assert dispatcher.actor(turn.scene_id, 2).options["label_selector"] == {}


def test_a_host_that_answers_nothing_is_killed_and_its_turn_goes_on_elsewhere(
    dispatching: Callable[..., Dispatcher],
) -> None:
    dispatcher = dispatching(FakeRay(one=(4, 0, 8)))
    deaf = dispatcher.runs("one")
    deaf.deaf = True
    dispatcher.actor(deaf.name, 1).place("one")
    assert deaf.dead


def test_without_the_cluster_a_job_says_so_unless_its_host_may_go_on_with_it(
    dispatching: Callable[..., Dispatcher],
) -> None:
    dispatcher = dispatching(FakeRay(), reached=False)
    turn, ends = dispatcher.turn()
    assert ends.result(_WITHIN_S) is WaitReason.CLUSTER
    assert dispatcher.hosts.status.slots == 0
    storage = dispatcher.hosts._storage
    with storage.database.writing() as session:
        move(session, Move.START, Mover.WORKER, JobRow.id == turn.job_id)
    assert dispatcher.run(turn).result(_WITHIN_S) is WaitReason.CLUSTER
    lease = storage.leases.acquire(turn.scene_id, "cluster")
    assert lease is not None
    running = dispatcher.run(turn)
    time.sleep(3 * _QUICK["_PATIENCE_S"])
    assert not running.done()
    dispatcher.hosts._connected.set()
    dispatcher.actor(turn.scene_id)


def test_a_runner_is_started_on_a_host_that_a_turn_then_uses(dispatching: Callable[..., Dispatcher]) -> None:
    ray = FakeRay(one=(4, 0, 8))
    dispatcher = dispatching(ray)
    turn, _ = dispatcher.turn()
    threads = [threading.Thread(target=dispatcher.hosts.start_runner, args=(turn.scene_id,))]
    threads[0].start()
    actor = dispatcher.actor(turn.scene_id)
    actor.place("one")
    threads[0].join(_WITHIN_S)
    _until(lambda: actor.calls["run"])
    assert len(actor.calls["start_runner"]) == 1
    assert ray.made == [actor]


class _EndedError(BaseException):
    """The process would end now."""


@contextmanager
def _host(monkeypatch: pytest.MonkeyPatch, **local: Any) -> Iterator[SceneHost]:
    def end(_status: int) -> None:
        raise _EndedError

    monkeypatch.setattr(scene_host, "os", SimpleNamespace(_exit=end))
    host = SceneHost("scene", "cluster", Settings(), Resources(1, 0, 1))
    host._hosts = SimpleNamespace(folder="/nonexistent", **local)  # type: ignore[assignment]
    yield host


def test_a_host_ends_when_it_is_to_leave_with_or_without_the_database(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stop() -> None:
        raise StorageUnavailableError("The database cannot be reached.")

    for leaves in (stop, lambda: None):
        with _host(monkeypatch, stop=leaves) as host, pytest.raises(_EndedError):
            host.leave()


def test_a_host_does_not_leave_while_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with _host(monkeypatch, stop=lambda: None) as host, host._in_use():
        assert not host.leave()


def test_the_status_of_a_host_asks_no_runner(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that does not answer would make the host deaf."""

    def idle_s() -> float:
        raise AssertionError("asked")

    status = SimpleNamespace(backend="cpu", runner_bytes=7)
    with _host(monkeypatch, status=status, idle_s=idle_s) as host:
        assert host.status().runner_bytes == 7
        with host._in_use():
            assert host.status().idle_s == 0.0
