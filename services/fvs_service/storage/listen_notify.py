"""Notifications by PostgreSQL's LISTEN and NOTIFY, over a connection of their own."""

import contextlib
import selectors
import threading
from collections.abc import Callable, Mapping
from typing import Any

import structlog
from sqlalchemy import Connection, Engine, func, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

_PREFIX = "fvs_"
_LOOK_S = 5.0
"""Interval at which a listener checks whether it was closed."""
_RECONNECT_S = 2.0

_log = structlog.get_logger()


def notify(session: Session, topic: str) -> None:
    """Notify all listeners when the transaction is committed."""
    session.execute(select(func.pg_notify(f"{_PREFIX}{topic}", "")))


class Listener:
    """A thread that listens on a connection of its own; it reconnects after a loss, and then calls back."""

    def __init__(self, engine: Engine, callbacks: Mapping[str, Callable[[], object]]) -> None:
        self._engine = engine
        self._callbacks = {f"{_PREFIX}{topic}": callback for topic, callback in callbacks.items()}
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True, name="notifications")
        self._thread.start()

    def close(self) -> None:
        """Stop listening; the connection is closed within seconds."""
        self._closed.set()

    def _listen(self) -> None:
        import psycopg  # only where it is the driver

        while not self._closed.is_set():
            try:
                with self._engine.connect() as connection:
                    self._receive(connection)
            except (SQLAlchemyError, psycopg.Error) as error:
                _log.warning("notifications interrupted", reason=type(error).__name__)
                self._closed.wait(_RECONNECT_S)

    def _receive(self, connection: Connection) -> None:
        connection.detach()  # the pool gets another one
        driver: Any = connection.connection.dbapi_connection
        driver.autocommit = True  # a connection inside a transaction receives no notifications
        for channel in self._callbacks:
            driver.execute(f"LISTEN {channel}")
        for callback in self._callbacks.values():  # for notifications missed before LISTEN
            callback()
        with selectors.DefaultSelector() as selector:
            selector.register(driver, selectors.EVENT_READ)
            while not self._closed.is_set():
                selector.select(_LOOK_S)  # psycopg's own wait wakes up ten times a second
                for received in driver.notifies(timeout=0):
                    with contextlib.suppress(KeyError):
                        if not self._closed.is_set():
                            self._callbacks[received.channel]()
