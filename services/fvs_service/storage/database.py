"""The database: SQLite in WAL mode on one machine, PostgreSQL for several.

``with database.reading() as session`` is a consistent read; ``with database.writing(*subjects) as session``
commits at the end. Transactions that write wait for each other at their start: on SQLite all of them, on
PostgreSQL those with a subject in common (the id of a scene, of a tenant). What a transaction reads about its
subjects stays true until it commits.
"""

import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import orjson
from sqlalchemy import (
    URL,
    Connection,
    Engine,
    create_engine,
    event,
    func,
    inspect,
    make_url,
    select,
    text,
)
from sqlalchemy.exc import DatabaseError, DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import Session

from fvs_service.errors import IncompatibleDatabaseError, OutOfSpaceError, StorageUnavailableError
from fvs_service.storage.commit_hooks import act_after_commit, act_before_commit
from fvs_service.storage.notifications import Subscription, Topic, subscribe

_BUSY_S = 30
_CONNECT_S = 5
_CONNECTIONS = 48
_IDLE_IN_TRANSACTION_S = 20
"""PostgreSQL ends a transaction that has been idle for this long, so that a frozen process holds no lock."""
_KEEPALIVE = {
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 15_000,
}
_MIGRATIONS = Path(__file__).with_name("migrations")
_VERSIONS = "alembic_version"
KNOWN_VERSIONS = tuple(sorted(file.name[:4] for file in (_MIGRATIONS / "versions").glob("[0-9]*.py")))
"""Versions of the schema, oldest first: the numbers that the names of the migrations begin with."""
_LOCKED = "fvs_locked"
_READ = ("BEGIN",)
_WRITE = ("PRAGMA synchronous = FULL", "BEGIN IMMEDIATE")
"""SQLite's statements before a transaction; a committed write survives a power cut."""
_WRITE_WITHOUT_SYNC = ("PRAGMA synchronous = NORMAL", "BEGIN IMMEDIATE")
"""Without waiting for the disk; the database stays consistent all the same."""
_JSON: Mapping[str, Any] = {
    "json_serializer": lambda document: orjson.dumps(document).decode(),
    "json_deserializer": orjson.loads,
}


Reader: TypeAlias = Session | Connection
"""What reads without making objects of rows."""


class Database:
    """One engine and its transactions; safe to use from any thread.

    Every method raises ``StorageUnavailableError`` while the database cannot be reached; what has not been
    committed by then is rolled back.
    """

    def __init__(self, url: str) -> None:
        parsed = make_url(url)
        self._engine = _sqlite(parsed) if parsed.get_backend_name() == "sqlite" else _postgresql(parsed)
        self._writer = self._engine.execution_options(fvs_begin=_WRITE)
        self._writer_without_sync = self._engine.execution_options(fvs_begin=_WRITE_WITHOUT_SYNC)
        self._reader = self._engine
        if self._engine.dialect.name == "postgresql":  # SQLite reads one state in any transaction
            self._reader = self._engine.execution_options(
                isolation_level="REPEATABLE READ", postgresql_readonly=True
            )

    def migrate(self) -> None:
        """Migrate the schema to the newest version; several processes may do so at once.

        Raises ``IncompatibleDatabaseError`` when a newer version of the service has migrated it further.
        """
        with self.reading() as session:
            if _version(session) == KNOWN_VERSIONS[-1]:
                return
        from alembic import command  # slow to import
        from alembic.config import Config

        config = Config()
        config.set_main_option("script_location", str(_MIGRATIONS))
        with self.writing("migration") as session:
            _require_known_version(_version(session))
            config.attributes["connection"] = session.connection()
            command.upgrade(config, "head")

    def require_migrated(self) -> None:
        """Raise ``IncompatibleDatabaseError`` unless the schema has the newest version; changes nothing."""
        with self.reading() as session:
            version = _version(session)
        _require_known_version(version)
        if version != KNOWN_VERSIONS[-1]:
            schema = f"version {version} of the schema" if version else "no schema"
            raise IncompatibleDatabaseError(
                f"The database has {schema}, and this program needs version {KNOWN_VERSIONS[-1]}.",
                hint="Back it up. Then fvs serve migrates it when it starts, as does fvs doctor --repair.",
            )

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session that reads one consistent state."""
        with _reachable(), Session(self._reader) as session:
            yield session

    @contextmanager
    def querying(self) -> Iterator[Connection]:
        """A connection that reads one consistent state: statements without objects take half of the time."""
        with _reachable(), self._reader.connect() as connection:
            yield connection

    @contextmanager
    def writing(self, *subjects: str, durable: bool = True) -> Iterator[Session]:
        """One transaction: committed when the block ends, rolled back when it raises.

        It begins when no other transaction about one of the ``subjects`` is in progress. Unless ``durable``,
        SQLite does not wait for the disk: the transaction survives the end of every process, but a power cut
        may undo it, with all of its kind since the last durable one. Raises ``OutOfSpaceError`` when the disk
        is full.
        """
        writer = self._writer if durable else self._writer_without_sync
        with _reachable(), Session(writer) as session:
            with session.begin():
                lock(session, *subjects)
                yield session
                act_before_commit(session)
            act_after_commit(session)

    def connect(self) -> Connection:
        """A connection for checks of the schema and of health."""
        return self._engine.connect()

    def subscribe(self, callbacks: Mapping[Topic, Callable[[], object]]) -> Subscription:
        """Call back, from another thread, when a transaction that announced a topic was committed."""
        return subscribe(self._engine, callbacks)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()


def sqlite_file(url: str) -> Path | None:
    """The file of an SQLite database; None for another database."""
    parsed = make_url(url)
    return Path(parsed.database) if parsed.get_backend_name() == "sqlite" and parsed.database else None


def lock(session: Session, *subjects: str) -> None:
    """Wait for other transactions about ``subjects``; what was read before is read again.

    To be called before the transaction writes anything: else two of them may wait for each other.
    """
    if session.get_bind().dialect.name != "postgresql":
        return  # it has the only lock
    locked = session.info.setdefault(_LOCKED, set())
    new = sorted(set(subjects) - locked)
    if not new:
        return
    session.flush()
    for subject in new:  # in one order everywhere
        session.execute(select(func.pg_advisory_xact_lock(func.hashtextextended(subject, 0))))
    locked.update(new)
    session.expire_all()


@contextmanager
def _reachable() -> Iterator[None]:
    try:
        yield
    except (DBAPIError, PoolTimeoutError) as error:
        if isinstance(error, DBAPIError) and not (
            error.connection_invalidated
            or isinstance(error, OperationalError | InterfaceError)
            or type(error) is DatabaseError  # SQLite's for a damaged file
        ):
            raise
        reason = str(error.orig) if isinstance(error, DBAPIError) else str(error)
        if any(sign in reason for sign in ("full", "disk I/O", "No space left")):
            raise OutOfSpaceError("The database's disk is full.", hint="Free some space.") from error
        raise StorageUnavailableError(
            "The database cannot be reached.",
            hint="Try again soon. If the error persists, the operator can run fvs doctor, and check "
            "FVS_DATABASE_URL.",
            retry_after_s=5,
        ) from error


def _version(session: Session) -> str | None:
    """The version of the database's schema; None before the first migration."""
    if not inspect(session.connection()).has_table(_VERSIONS):
        return None
    version: str | None = session.scalar(text(f"SELECT version_num FROM {_VERSIONS}"))
    return version


def _require_known_version(version: str | None) -> None:
    if version is None or version in KNOWN_VERSIONS:
        return
    raise IncompatibleDatabaseError(
        f"The database has version {version} of the schema, and this program knows it up to "
        f"{KNOWN_VERSIONS[-1]}.",
        hint="A newer version of the service has migrated it: install that version, or restore a "
        "backup from before.",
    )


def _postgresql(url: URL) -> Engine:
    return create_engine(
        url.set(drivername="postgresql+psycopg"),
        pool_pre_ping=True,  # connections that a restart of the server has cut are replaced
        pool_size=_CONNECTIONS // 4,
        max_overflow=_CONNECTIONS,
        **_JSON,
        connect_args={
            "connect_timeout": _CONNECT_S,
            "application_name": "fvs",
            "options": f"-c lock_timeout={_BUSY_S}s "
            f"-c idle_in_transaction_session_timeout={_IDLE_IN_TRANSACTION_S}s",
            **_KEEPALIVE,
        },
    )


def _sqlite(url: URL) -> Engine:
    if url.database:
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(
        url,
        connect_args={"timeout": _BUSY_S},
        pool_size=_CONNECTIONS,
        max_overflow=_CONNECTIONS,
        pool_use_lifo=True,  # the connection that was used last has the newest pages in its cache
        **_JSON,
    )

    @event.listens_for(engine, "connect")
    def _configure(connection: sqlite3.Connection, _record: Any) -> None:
        connection.isolation_level = None  # transactions begin below, not in the driver
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA foreign_keys = ON")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        for statement in connection.get_execution_options().get("fvs_begin", _READ):
            connection.exec_driver_sql(statement)

    return engine
