"""The parts of hosts on a cluster that need no cluster: fencing, resources, settings, reasons to wait."""

import socket
from pathlib import Path
from typing import Any, NoReturn
from unittest.mock import Mock

import pytest
from fvs_service.errors import StaleLeaseError
from fvs_service.host.cluster.connection import ClusterUnavailableError, connect, origin, plain
from fvs_service.host.cluster.leases import HostLeases
from fvs_service.host.cluster.resources import Resources, need_to_rank
from fvs_service.host.cluster.scene_host import SceneHost
from fvs_service.jobs.order import OpenJob, Order, Place
from fvs_service.jobs.waiting import Workers, why_it_waits
from fvs_service.principal import LOCAL_USER
from fvs_service.scenes.lease import require_lease
from fvs_service.scenes.service import Scenes
from fvs_service.settings import BlobSettings, Settings, WorkerSettings
from fvs_service.storage.database import Database
from pydantic import ValidationError
from ray.exceptions import ActorDiedError, RayTaskError

from fvs_schema.jobs import JobKind, WaitReason
from fvs_schema.scenes import SceneRequest
from fvs_schema.service import Limits


class _ReplacedError(Exception):
    """The host would end now."""


def _replaced() -> NoReturn:
    raise _ReplacedError


@pytest.fixture
def scene_of(tmp_path: Path) -> tuple[Database, str]:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    return database, Scenes(database, Limits()).create(LOCAL_USER, SceneRequest(name="yard")).id


def test_a_new_host_takes_the_lease_at_once_and_the_old_one_ends(scene_of: tuple[Database, str]) -> None:
    database, scene = scene_of
    old = HostLeases(database, 20.0, scene, _replaced)
    lease = old.acquire(scene, "cluster")
    assert lease is not None
    new = HostLeases(database, 20.0, scene, _replaced)
    newer = new.acquire(scene, "cluster")
    assert newer is not None
    assert newer.token > lease.token
    with pytest.raises(StaleLeaseError), database.writing() as session:
        require_lease(session, lease)
    for attempt in (lambda: old.extend(lease), lambda: old.acquire(scene, "cluster")):
        with pytest.raises(_ReplacedError):
            attempt()
    assert new.extend(newer).token == newer.token


def test_a_host_that_wakes_up_before_its_first_lease_does_not_take_it_from_a_newer_one(
    scene_of: tuple[Database, str],
) -> None:
    database, scene = scene_of
    frozen, awake = (HostLeases(database, 20.0, scene, _replaced) for _ in range(2))
    assert awake.acquire(scene, "cluster") is not None
    with pytest.raises(_ReplacedError):
        frozen.acquire(scene, "cluster")


def test_a_host_leases_its_scene_again_after_it_has_released_it(scene_of: tuple[Database, str]) -> None:
    database, scene = scene_of
    leases = HostLeases(database, 20.0, scene, _replaced)
    first = leases.acquire(scene, "cluster")
    assert first is not None
    leases.release(first)
    second = leases.acquire(scene, "cluster")
    assert second is not None
    assert second.token > first.token


def test_a_scene_takes_memory_in_powers_of_two_and_ranks_without_a_gpu() -> None:
    need = need_to_rank(WorkerSettings(threads=3), 1_500_000_000, gpus=1.0)
    assert need == Resources(cpus=3, gpus=0.0, memory_bytes=2 << 30, trains=False)
    assert need_to_rank(WorkerSettings(), 1, gpus=0.0) == Resources(2, 0.0, 1 << 30, trains=True)


@pytest.mark.parametrize("lacking", [Resources(1, 1, 4), Resources(2, 0.5, 4), Resources(2, 1, 3)])
def test_resources_cover_a_need_only_if_none_is_short(lacking: Resources) -> None:
    need = Resources(2, 1, 4)
    assert need.cover(need)
    assert not lacking.cover(need)


def test_a_cluster_needs_a_database_and_a_store_that_its_nodes_reach() -> None:
    blobs = BlobSettings(url="s3://bucket")
    assert Settings(cluster="auto", database_url="postgresql://x", blobs=blobs).cluster == "auto"
    for given in ({"blobs": blobs}, {"database_url": "postgresql://x"}):
        with pytest.raises(ValidationError, match="FVS_DATABASE_URL"):
            Settings(cluster="auto", **given)
    for address in ("ray://head", "http://head:10001", "head:6379", ""):
        with pytest.raises(ValidationError, match="ray://host:10001"):
            Settings(cluster=address, database_url="postgresql://x", blobs=blobs)


@pytest.mark.process
@pytest.mark.parametrize(
    ("error", "says", "remedy"),
    [
        (RuntimeError("Version mismatch: The cluster has:\n    Ray: 2.53.0"), "2.53.0", "same versions"),
        (ConnectionError("ray client connection timeout"), "timeout", "RAY_AUTH_TOKEN_PATH"),
        (ConnectionError("Failure:\nTraceback (most recent call last):\n  …\nOSError: no\n"), "no", "10001"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_reported_in_a_line_with_the_remedy(
    error: Exception, says: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def init(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("ray.init", init)
    with socket.create_server(("127.0.0.1", 0)) as head:
        address = f"ray://127.0.0.1:{head.getsockname()[1]}"
        with pytest.raises(ClusterUnavailableError) as refused:
            connect(address, "fvs")
    assert address in refused.value.message
    assert says in refused.value.message
    assert "\n" not in refused.value.message
    assert "Traceback" not in refused.value.message
    assert remedy in refused.value.hint


@pytest.mark.process
def test_a_head_that_does_not_run_is_reported_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ray.init", lambda *_, **__: pytest.fail("Ray would wait for it"))
    with socket.create_server(("127.0.0.1", 0)) as head:
        port = head.getsockname()[1]
    with pytest.raises(ClusterUnavailableError, match="refused") as refused:
        connect(f"ray://127.0.0.1:{port}", "fvs")
    assert "10001" in refused.value.hint


def test_the_error_of_a_host_that_cannot_start_names_the_node_and_the_reason() -> None:
    trace = "\x1b[36mray::SceneHost.__init__() (pid=1, ip=10.1.2.3, actor_id=f0)\n\nModuleNotFoundError: no"
    task_error: Any = RayTaskError  # not typed
    error = ActorDiedError(task_error("__init__", trace, ModuleNotFoundError(), "ray", 1, "10.1.2.3"))
    assert plain(error) == "ModuleNotFoundError: no"
    assert origin(error) == "10.1.2.3"


def test_a_host_refuses_a_dispatcher_of_another_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ray.get_runtime_context", lambda: Mock(get_node_id=lambda: "node"))
    host = SceneHost("scene", "cluster", Settings(), Resources(1, 0, 1))
    refusal = host.open("0.0.1").refusal
    assert "0.0.1" in refusal
    assert "same version" in refusal


def test_a_job_that_lacked_something_in_its_last_turn_says_so_until_the_next() -> None:
    job = OpenJob("job", "tenant", "scene", JobKind.UPDATE, waiting_since_ms=0, obstacle=WaitReason.CLUSTER)
    order = Order(jobs=(job,), tenants_served_ms={}, limit=4, turn_ms=30_000, now_ms=1)
    (place,) = order.line
    waiting = why_it_waits(place, order, Workers(1, 2, 2), {JobKind.UPDATE: 10.0})
    assert waiting.reason is WaitReason.CLUSTER
    assert waiting.eta_s is None


@pytest.mark.parametrize(
    ("obstacle", "workers", "reason"),
    [
        (None, Workers(alive=1, slots=0, slots_with_room=0), WaitReason.CLUSTER),
        (None, Workers(alive=0, slots=0, slots_with_room=0), WaitReason.NO_WORKER),
        (WaitReason.NO_NODE, Workers(alive=1, slots=2, slots_with_room=2), WaitReason.NO_NODE),
        (WaitReason.GPU, Workers(alive=1, slots=2, slots_with_room=2), WaitReason.GPU),
    ],
)
def test_a_job_without_a_place_says_what_the_cluster_lacks(
    obstacle: WaitReason | None, workers: Workers, reason: WaitReason
) -> None:
    job = OpenJob("job", "tenant", "scene", JobKind.UPDATE, waiting_since_ms=0)
    order = Order(jobs=(job,), tenants_served_ms={}, limit=4, turn_ms=30_000, now_ms=1)
    waiting = why_it_waits(Place(job, 1, obstacle), order, workers, {JobKind.UPDATE: 10.0})
    assert waiting.reason is reason
    assert waiting.message
    assert (waiting.eta_s is None) is (reason is not WaitReason.GPU)


def test_a_scene_takes_a_share_of_a_gpu_or_whole_gpus() -> None:
    for gpus in (0.0, 0.5, 1.0, 2.0):
        assert WorkerSettings(gpus=gpus).gpus == gpus
    with pytest.raises(ValidationError, match="whole number"):
        WorkerSettings(gpus=1.5)
