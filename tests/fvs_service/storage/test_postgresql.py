"""What differs on PostgreSQL, whose transactions run beside each other, and which can be away."""

import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from fvs_service.errors import IncompatibleDatabaseError, ServiceError, StorageUnavailableError
from fvs_service.events.repository import events_after, publish
from fvs_service.ids import new_id
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.states import submit
from fvs_service.principal import LOCAL_USER
from fvs_service.scenes.lease import Lease, Leases, require_lease
from fvs_service.scenes.service import Scenes
from fvs_service.storage.clock import now
from fvs_service.storage.database import KNOWN_VERSIONS, Database
from fvs_service.storage.notifications import Topic
from fvs_service.storage.tables import Table
from postgresql_server import PostgresqlServer
from sqlalchemy import text

from fvs_schema.events import EventKind
from fvs_schema.jobs import JobKind, JobRequest
from fvs_schema.scenes import SceneRequest
from fvs_schema.service import Limits

pytestmark = pytest.mark.process


@pytest.fixture(params=["postgresql", "sqlite"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    """An empty database of either kind."""
    if request.param == "postgresql":
        url = request.getfixturevalue("postgresql").create_database(uuid4().hex)
    else:
        url = f"sqlite:///{tmp_path / 'fvs.sqlite3'}"
    database = Database(url)
    database.migrate()
    yield database
    database.close()


@pytest.fixture(scope="module")
def fresh_server() -> Iterator[PostgresqlServer]:
    """A server of one's own that does not run yet.

    It does not lie below pytest's folder: another pytest of this user closes that to the server's user.
    """
    with tempfile.TemporaryDirectory(prefix="fvs-postgresql-") as folder:
        yield PostgresqlServer(Path(folder) / "server")


@pytest.fixture
def own_server(fresh_server: PostgresqlServer) -> Iterator[PostgresqlServer]:
    """A server that a test may stop and start again."""
    fresh_server.start()
    yield fresh_server
    fresh_server.stop()


def at_once(*calls: Callable[[], object]) -> list[Exception]:
    """Run calls in threads that start together; returns what they raised."""
    start, raised = threading.Barrier(len(calls)), []

    def run(call: Callable[[], object]) -> None:
        start.wait()
        try:
            call()
        except Exception as error:
            raised.append(error)

    threads = [threading.Thread(target=run, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


def new_scene(database: Database) -> str:
    return Scenes(database, Limits()).create(LOCAL_USER, SceneRequest(name="a scene")).id


def publish_and(then: Callable[[], object], database: Database, scene: str) -> None:
    with database.writing() as session:
        publish(session, scene, EventKind.SCENE_CHANGED, {})
        then()


def test_migrations_make_the_tables_that_the_code_uses(database: Database) -> None:
    assert at_once(*[database.migrate] * 4) == []
    with database.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Table.metadata) == []


def test_a_database_of_a_newer_schema_is_refused(database: Database) -> None:
    with database.writing() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(IncompatibleDatabaseError, match=rf"version 9999 .* up to {KNOWN_VERSIONS[-1]}"):
        database.migrate()


def test_a_limit_holds_for_requests_that_arrive_at_once(database: Database) -> None:
    scenes = Scenes(database, Limits(scenes_per_tenant=3))
    refused = at_once(*[lambda: scenes.create(LOCAL_USER, SceneRequest(name="one"))] * 8)
    assert [type(error).__name__ for error in refused] == ["LimitExceededError"] * 5


def test_a_repeated_request_that_arrives_at_once_creates_one_scene(database: Database) -> None:
    scenes, made = Scenes(database, Limits()), set()
    request = SceneRequest(name="one")
    assert at_once(*[lambda: made.add(scenes.create(LOCAL_USER, request, "a key").id)] * 8) == []
    assert len(made) == 1


def test_workers_that_ask_at_once_take_each_job_once_and_keep_the_tenants_limit(database: Database) -> None:
    for job in [new_id("job") for _ in range(6)]:
        scene = new_scene(database)
        with database.writing(scene) as session:
            submit(session, job, scene, LOCAL_USER.tenant_id, JobRequest(kind=JobKind.UPDATE), now())
    queue = JobQueue(database, jobs_per_tenant=4, turn_s=30)
    taken: list[str] = []

    def work(worker: str) -> None:
        while turn := queue.take(worker):
            taken.append(turn.job_id)

    assert at_once(*[lambda name=name: work(f"worker-{name}") for name in range(6)]) == []
    assert len(taken) == len(set(taken)) == 4


def test_one_of_many_workers_gets_a_lease(database: Database) -> None:
    scene, leases, got = new_scene(database), Leases(database, 20), []
    assert at_once(*[lambda name=name: got.append(leases.acquire(scene, name)) for name in "abcdef"]) == []
    assert sum(lease is not None for lease in got) == 1


def test_who_has_read_an_event_has_read_all_with_smaller_numbers(database: Database) -> None:
    scene = new_scene(database)
    done, seen, gaps = threading.Event(), [0], []

    def write(number: int) -> None:
        for _ in range(8):
            with database.writing() as session:
                publish(session, scene, EventKind.SCENE_CHANGED, {})
                if number % 2:
                    session.flush()
                    time.sleep(0.003)  # an earlier transaction may end later

    def follow() -> None:
        while not done.is_set() or not gaps:
            ended = done.is_set()
            with database.reading() as session:
                seen.extend(event.number for event in events_after(session, scene, seen[-1]))
            if ended:
                gaps.append(True)

    follower = threading.Thread(target=follow)
    follower.start()
    assert at_once(*[lambda number=number: write(number) for number in range(4)]) == []
    done.set()
    follower.join()
    with database.reading() as session:
        assert seen[1:] == [event.number for event in events_after(session, scene, 0)]
    assert len(seen) == 1 + 33


def test_a_frozen_worker_cannot_commit_and_does_not_hold_up_others(postgresql: PostgresqlServer) -> None:
    database = Database(postgresql.create_database(uuid4().hex))
    database.migrate()
    scene, leases = new_scene(database), Leases(database, 0.2)
    lease = leases.acquire(scene, "frozen")
    assert lease is not None
    taken: list[Lease | None] = []

    def freeze() -> None:
        with database.writing(scene) as session:
            session.execute(text("SET LOCAL idle_in_transaction_session_timeout = '300ms'"))  # usually 20 s
            require_lease(session, lease)
            while not any(taken):
                taken.append(leases.acquire(scene, "other"))  # waits until the server ends the transaction
            require_lease(session, lease)

    with pytest.raises(StorageUnavailableError):
        freeze()
    with pytest.raises(ServiceError, match="has lost the lease"), database.writing(scene) as session:
        require_lease(session, lease)
    database.close()


@pytest.mark.system
def test_a_server_that_restarts_costs_an_error_and_nothing_else(own_server: PostgresqlServer) -> None:
    database = Database(own_server.create_database(uuid4().hex))
    database.migrate()
    scene = new_scene(database)
    with pytest.raises(StorageUnavailableError, match="cannot be reached"):
        publish_and(own_server.stop, database, scene)
    with pytest.raises(StorageUnavailableError):
        new_scene(database)
    own_server.start()
    with database.reading() as session:
        assert [event.kind for event in events_after(session, scene, 0)] == [EventKind.SCENE_CREATED]
    database.close()


@pytest.mark.system
def test_a_commit_wakes_those_who_wait_also_after_a_restart(own_server: PostgresqlServer) -> None:
    database = Database(own_server.create_database(uuid4().hex))
    try:
        database.migrate()
        heard = threading.Event()
        with contextlib.closing(database.subscribe({Topic.EVENTS: heard.set})):
            for again in (False, True):
                if again:
                    own_server.stop()
                    own_server.start()
                assert heard.wait(60)  # it listens from now on
                heard.clear()
                new_scene(database)
                assert heard.wait(60)
                heard.clear()
    finally:
        database.close()
