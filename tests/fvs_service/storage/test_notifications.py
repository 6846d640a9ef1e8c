"""Notifications through named pipes: what is committed wakes other processes."""

import contextlib
import os
import queue
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fvs_service.storage.database import Database
from fvs_service.storage.notifications import Topic, announce

_WITHIN_S = 30


@pytest.fixture
def connect(tmp_path: Path) -> Iterator[Callable[[], Database]]:
    """A process's own connection to the shared database."""
    with contextlib.ExitStack() as stack:

        def connect() -> Database:
            database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
            stack.callback(database.close)
            return database

        yield connect


class Heard:
    """What a subscriber was called back for."""

    def __init__(self, database: Database) -> None:
        self._topics: queue.Queue[Topic] = queue.Queue()
        callbacks = {topic: lambda topic=topic: self._topics.put(topic) for topic in Topic}
        self.subscription = database.subscribe(callbacks)

    def next(self) -> Topic:
        return self._topics.get(timeout=_WITHIN_S)


def test_a_commit_wakes_every_process(connect: Callable[[], Database]) -> None:
    heard = [Heard(connect()), Heard(connect())]
    with connect().writing() as session:
        announce(session, Topic.JOBS)
    assert [one.next() for one in heard] == [Topic.JOBS, Topic.JOBS]
    for one in heard:
        one.subscription.close()


def test_a_transaction_that_is_rolled_back_wakes_nobody(connect: Callable[[], Database]) -> None:
    heard, database = Heard(connect()), connect()
    with contextlib.suppress(ZeroDivisionError), database.writing() as session:
        announce(session, Topic.JOBS)
        raise ZeroDivisionError
    with database.writing() as session:
        announce(session, Topic.EVENTS)
    assert heard.next() is Topic.EVENTS
    heard.subscription.close()


def test_all_topics_of_a_transaction_are_heard(connect: Callable[[], Database]) -> None:
    heard = Heard(connect())
    with connect().writing() as session:
        for topic in (Topic.EVENTS, Topic.JOBS, Topic.EVENTS):
            announce(session, topic)
    assert {heard.next(), heard.next()} == {Topic.EVENTS, Topic.JOBS}
    heard.subscription.close()


def test_a_process_is_not_woken_for_other_topics(connect: Callable[[], Database], tmp_path: Path) -> None:
    heard = Heard(connect())
    pipe = tmp_path / "fvs.sqlite3-listeners" / "er-listener"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    for topics in ([Topic.JOBS], [Topic.JOBS, Topic.EVENTS]):
        with connect().writing() as session:
            for topic in topics:
                announce(session, topic)
    assert heard.next() is Topic.JOBS
    assert os.read(reader, 100) == b"e"
    os.close(reader)
    heard.subscription.close()


def test_a_process_that_died_is_forgotten(connect: Callable[[], Database], tmp_path: Path) -> None:
    folder = tmp_path / "fvs.sqlite3-listeners"
    heard = Heard(connect())
    os.mkfifo(folder / "j-dead")  # nobody reads it
    with connect().writing() as session:
        announce(session, Topic.JOBS)
    assert heard.next() is Topic.JOBS
    assert not (folder / "j-dead").exists()
    heard.subscription.close()
    assert list(folder.iterdir()) == []


def test_a_commit_succeeds_without_anybody_who_listens(connect: Callable[[], Database]) -> None:
    with connect().writing() as session:
        announce(session, Topic.JOBS)


def test_a_full_pipe_does_not_hold_a_commit(connect: Callable[[], Database], tmp_path: Path) -> None:
    database, folder = connect(), tmp_path / "fvs.sqlite3-listeners"
    folder.mkdir()
    os.mkfifo(folder / "frozen")
    reader = os.open(folder / "frozen", os.O_RDWR | os.O_NONBLOCK)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(reader, b"." * 4096)
    with database.writing() as session:
        announce(session, Topic.JOBS)
    assert (folder / "frozen").exists()
    os.close(reader)
