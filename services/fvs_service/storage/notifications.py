"""Notifications between processes: a commit wakes the processes that wait for what it changed.

A notification has a topic and nothing else: its receivers look in the database. One that is lost only delays
them until they look by themselves, which they do seldom. SQLite's processes are on one machine and notify
each other through named pipes (``named_pipes``); PostgreSQL has notifications of its own (``listen_notify``).
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Protocol

from sqlalchemy import Engine
from sqlalchemy.orm import Session

from fvs_service.storage import listen_notify, named_pipes
from fvs_service.storage.commit_hooks import after_commit

_ANNOUNCED = "fvs_announced"


class Topic(StrEnum):
    """What has changed. The values are names of channels in PostgreSQL, and their first letters in pipes."""

    JOBS = "jobs"
    """A job waits, or a place for one is free."""
    RUNNERS = "runners"
    """A scene's runner is requested."""
    EVENTS = "events"
    """There is a new event."""


class Subscription(Protocol):
    """Calls back for notifications, from a thread of its own, until it is closed."""

    def close(self) -> None:
        """Stop listening."""


def announce(session: Session, topic: Topic) -> None:
    """Notify all subscribers of the topic, in all processes, once the transaction is committed."""
    announced: set[Topic] = session.info.setdefault(_ANNOUNCED, set())
    if topic in announced:
        return
    announced.add(topic)
    engine = session.get_bind().engine
    if engine.dialect.name == "postgresql":
        listen_notify.notify(session, topic)
    elif len(announced) == 1 and (folder := _folder(engine)) is not None:
        after_commit(session, lambda: named_pipes.notify(folder, announced))


def subscribe(engine: Engine, callbacks: Mapping[Topic, Callable[[], object]]) -> Subscription:
    """Call back for each notification of the topics; several in a short time may cause one call.

    Callbacks are also called without a change, for instance after a lost connection.
    """
    named = {topic.value: callback for topic, callback in callbacks.items()}
    if engine.dialect.name == "postgresql":
        return listen_notify.Listener(engine, named)
    folder = _folder(engine)
    return _NoSubscription() if folder is None else named_pipes.Listener(folder, named)


def _folder(engine: Engine) -> Path | None:
    """The folder of the pipes, beside SQLite's file; None where there are no named pipes."""
    file = engine.url.database
    if not named_pipes.AVAILABLE or not file or file == ":memory:":
        return None
    return Path(f"{file}-listeners")


class _NoSubscription:
    """A subscription where there are no notifications."""

    def close(self) -> None:
        """Do nothing."""
