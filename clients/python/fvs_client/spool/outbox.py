"""The outbox: which photographs wait, are being sent, were sent or refused, in one SQLite file."""

import json
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fvs_client.spool.errors import SpoolError, unusable
from fvs_client.spool.photograph import NewPhotograph, Photograph, Refusal, State
from fvs_schema.names import readable_name

FILE_NAME = ".fvs-spool.sqlite3"
SIDECAR_REFUSED = "invalid-sidecar"
FILE_MISSING = "file-missing"
CUT_OFF = "cut-off"
"""The file has no end; with other content it is another photograph, and this one is gone."""
TEST = "test-photograph"
"""The code of one that nobody wants in a scene: it is refused, but not counted."""

_VERSION = 1
_SCHEMA = """
CREATE TABLE photographs (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    path BLOB NOT NULL,
    scene TEXT NOT NULL,
    name TEXT NOT NULL,
    digest TEXT NOT NULL,
    size_bytes INTEGER NOT NULL,
    mtime_ns INTEGER NOT NULL,
    sidecar TEXT NOT NULL,
    metadata TEXT NOT NULL,
    state TEXT NOT NULL,
    upload TEXT,
    offset_bytes INTEGER NOT NULL DEFAULT 0,
    setbacks INTEGER NOT NULL DEFAULT 0,
    verdict TEXT,
    code TEXT,
    reason TEXT,
    hint TEXT,
    deleted INTEGER NOT NULL DEFAULT 0,
    UNIQUE (path, scene, digest)
);
CREATE INDEX photographs_by_state ON photographs (state, number);
CREATE INDEX photographs_by_digest ON photographs (digest);
CREATE TABLE trouble (message TEXT NOT NULL, hint TEXT NOT NULL);
"""
# Pages that are free inside the file, and a log of that size: on a full card an acknowledgement can still be
# written, and then sent photographs can be deleted.
_RESERVE = """
CREATE TABLE reserve (bytes BLOB);
INSERT INTO reserve VALUES (zeroblob(262144));
DROP TABLE reserve;
"""
_CHECKPOINT_PAGES = 64
_SETBACKS_PER_TURN = 16
"""Number of setbacks after which another photograph has its turn: this one may be the cause."""
_DELETABLE = """
number > ? AND state = 'sent' AND verdict = 'accepted' AND deleted = 0 AND NOT EXISTS (
    SELECT 1 FROM photographs AS other
    WHERE other.path = photographs.path AND other.digest = photographs.digest
    AND other.state != 'sent'
)
"""
_COLUMNS = (
    "number, path, scene, name, digest, size_bytes, mtime_ns, metadata, state, upload, offset_bytes, "
    "setbacks, verdict, code, reason, hint, deleted"
)


class Outbox:
    """One connection to an outbox; each thread and process opens its own.

    What a method writes is on the disk when it returns, except offsets, which the service knows too. Raises
    ``SpoolError`` where the file cannot be used.
    """

    def __init__(self, path: Path, *, create: bool = True) -> None:
        self.path = path
        self._folder = os.fsencode(path.parent.resolve())
        if not create and not path.exists():
            there = path.parent.exists()
            raise SpoolError(
                f"There is no outbox in {path.parent}." if there else f"{path.parent} does not exist.",
                hint="Give the folder that `fvs-client spool watch` or `add` was called with, or --outbox.",
            )
        try:
            self._open()
        except sqlite3.Error as error:
            raise unusable(path, error) from error
        status = path.stat()
        self._identity = (status.st_dev, status.st_ino)

    def close(self) -> None:
        """Close the connection."""
        self._database.close()

    def __enter__(self) -> "Outbox":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def in_place(self) -> bool:
        """Whether the file that is open is still the one at ``path``, and others see changes."""
        try:
            status = self.path.stat()
        except OSError:
            return False
        return (status.st_dev, status.st_ino) == self._identity

    def add(self, new: NewPhotograph, *, durable: bool = True) -> Photograph:
        """Add a photograph, or update the metadata of one that is there and was not sent yet.

        A refused one waits again if its metadata have changed and the service keeps nothing of it.
        """
        metadata = json.dumps(new.metadata or {}, ensure_ascii=False)
        where = (self._stored(new.path), new.scene, new.digest)
        refusal = new.refusal
        reason = (None, None, None) if refusal is None else _columns(refusal)
        state = State.WAITING if refusal is None else State.REFUSED
        with self._writing(durable=durable) as database:
            database.execute(
                "DELETE FROM photographs WHERE path = ? AND scene = ? AND digest != ? AND code = ?",
                (*where, CUT_OFF),
            )
            database.execute(
                "INSERT INTO photographs (path, scene, digest, name, size_bytes, mtime_ns, sidecar, "
                "metadata, state, code, reason, hint) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
                "ON CONFLICT (path, scene, digest) DO UPDATE SET mtime_ns = excluded.mtime_ns, "
                "sidecar = excluded.sidecar, deleted = 0",
                (*where, new.name, new.size_bytes, new.mtime_ns, new.sidecar, metadata, state, *reason),
            )
            database.execute(
                "UPDATE photographs SET name = ?, metadata = ?, state = ?, code = ?, reason = ?, hint = ?, "
                "offset_bytes = 0 WHERE path = ? AND scene = ? AND digest = ? AND (state = 'waiting' "
                "OR code IN (?, ?) OR (state = 'refused' AND verdict IS NULL AND metadata != ?))",
                (new.name, metadata, state, *reason, *where, SIDECAR_REFUSED, FILE_MISSING, metadata),
            )
            found = self._select("path = ? AND scene = ? AND digest = ?", where)
        return found[0]

    def has(self, path: Path, scene: str, size_bytes: int, mtime_ns: int, sidecar: str) -> bool:
        """Whether this file, as it is now, was added and not missing since: it need not be read again."""
        query = (
            "SELECT 1 FROM photographs WHERE path = ? AND scene = ? AND size_bytes = ? AND mtime_ns = ? "
            "AND sidecar = ? AND code IS NOT ?"
        )
        row = (self._stored(path), scene, size_bytes, mtime_ns, sidecar, FILE_MISSING)
        return self._database.execute(query, row).fetchone() is not None

    def next(self, *, newest_first: bool) -> Photograph | None:
        """The photograph to send next; None when nothing waits."""
        order = f"setbacks / {_SETBACKS_PER_TURN}, number {'DESC' if newest_first else 'ASC'}"
        found = self._select("state IN ('waiting', 'sending')", (), f"ORDER BY {order} LIMIT 1")
        return found[0] if found else None

    def get(self, number: int) -> Photograph:
        """One photograph, by its number. Raises ``KeyError``."""
        found = self._select("number = ?", (number,))
        if not found:
            raise KeyError(number)
        return found[0]

    def was_sent(self, scene: str, digest: str) -> bool:
        """Whether a photograph with the same bytes was acknowledged."""
        query = "SELECT 1 FROM photographs WHERE digest = ? AND scene = ? AND state = 'sent'"
        return self._database.execute(query, (digest, scene)).fetchone() is not None

    def begin(self, number: int, upload: str | None) -> None:
        """Record that sending begins, with the service's id of the upload."""
        self._update(number, "state = 'sending', upload = ?", upload)

    def confirm(self, number: int, offset_bytes: int) -> None:
        """Record how much the service has; progress resets the setbacks."""
        change = "setbacks = CASE WHEN ? > offset_bytes THEN 0 ELSE setbacks END, offset_bytes = ?"
        self._update(number, change, offset_bytes, offset_bytes, durable=False)

    def set_back(self, number: int) -> None:
        """Record a failure that the service answered."""
        self._update(number, "setbacks = setbacks + 1")

    def forget_upload(self, number: int) -> None:
        """Record that the service no longer has the upload, so that it starts again from its first byte."""
        self._update(number, "upload = NULL, offset_bytes = 0")

    def acknowledge(self, number: int, verdict: str) -> None:
        """Record that the service has acknowledged the digest."""
        self._update(
            number,
            "state = 'sent', verdict = ?, upload = NULL, offset_bytes = size_bytes, setbacks = 0, "
            "code = NULL, reason = NULL, hint = NULL",
            verdict,
        )

    def refuse(self, number: int, refusal: Refusal, verdict: str | None = None) -> None:
        """Keep a photograph from being sent again before ``retry``."""
        self._update(
            number,
            "state = 'refused', verdict = ?, code = ?, reason = ?, hint = ?, upload = NULL, setbacks = 0",
            verdict,
            *_columns(refusal),
        )

    def retry(self, number: int) -> None:
        """Let a refused photograph wait again."""
        self._update(
            number,
            "state = 'waiting', verdict = NULL, code = NULL, reason = NULL, hint = NULL, offset_bytes = 0",
        )

    def forget(self, number: int) -> None:
        """Remove a refused photograph from the outbox; its file stays."""
        with self._writing() as database:
            database.execute("DELETE FROM photographs WHERE number = ? AND state = 'refused'", (number,))

    def deletable(self, after: int = 0) -> list[Photograph]:
        """Up to 100 photographs after number ``after`` whose files may be deleted, oldest first.

        The service keeps their bytes, and no other scene is to have the same file that lacks it.
        """
        return self._select(_DELETABLE, (after,), "ORDER BY number LIMIT 100")

    def set_deleted(self, photograph: Photograph) -> None:
        """Record that the file was deleted, or has other bytes; for all scenes that it was added for."""
        with self._writing() as database:
            database.execute(
                "UPDATE photographs SET deleted = 1 WHERE path = ? AND digest = ?",
                (self._stored(photograph.path), photograph.digest),
            )

    def kept_bytes(self) -> int:
        """Size of the files that were not deleted, in bytes: each once, with its newest content."""
        kept = "SELECT size_bytes, max(number) FROM photographs WHERE deleted = 0 GROUP BY path"
        (size,) = self._database.execute(f"SELECT coalesce(sum(size_bytes), 0) FROM ({kept})").fetchone()
        return int(size)

    def all(self) -> list[Photograph]:
        """Every photograph, in the order of arrival."""
        return self._select("1", (), "ORDER BY number")

    def last_number(self) -> int:
        """The number of the newest photograph; 0 without one."""
        (number,) = self._database.execute("SELECT coalesce(max(number), 0) FROM photographs").fetchone()
        return int(number)

    def added_after(self, number: int) -> list[Photograph]:
        """The photographs with higher numbers, in the order of arrival."""
        return self._select("number > ?", (number,), "ORDER BY number")

    def counts(self) -> dict[State, int]:
        """How many photographs are in each state, without test photographs."""
        query = "SELECT state, count(*) FROM photographs WHERE code IS NOT ? GROUP BY state"
        rows = dict(self._database.execute(query, (TEST,)).fetchall())
        return {state: rows.get(state, 0) for state in State}

    def set_trouble(self, message: str | None, hint: str = "") -> None:
        """Record why nothing is sent now; None: there is no trouble."""
        with self._writing() as database:
            database.execute("DELETE FROM trouble")
            if message is not None:
                database.execute("INSERT INTO trouble VALUES (?, ?)", (message, hint))

    def trouble(self) -> tuple[str, str] | None:
        """Why nothing could be sent the last time, and what to do about it."""
        row = self._database.execute("SELECT message, hint FROM trouble").fetchone()
        return None if row is None else (row[0], row[1])

    def _open(self) -> None:
        self._database = sqlite3.connect(self.path, timeout=30.0, isolation_level=None)
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
        self._database.execute("PRAGMA cache_size = -512")  # kB
        with self._writing() as database:
            (version,) = database.execute("PRAGMA user_version").fetchone()
            if version == 0:
                for statement in filter(str.strip, (_SCHEMA + _RESERVE).split(";")):
                    database.execute(statement)
                database.execute(f"PRAGMA user_version = {_VERSION}")
        if version > _VERSION:
            raise SpoolError(
                f"{self.path} was made by a newer fvs-client.", hint="Update fvs-client on this machine."
            )

    def _update(self, number: int, change: str, *values: object, durable: bool = True) -> None:
        with self._writing(durable=durable) as database:
            database.execute(f"UPDATE photographs SET {change} WHERE number = ?", (*values, number))

    @contextmanager
    def _writing(self, *, durable: bool = True) -> Iterator[sqlite3.Connection]:
        """A transaction; one that is not ``durable`` may be undone by a power cut."""
        self._database.execute(f"PRAGMA synchronous = {'FULL' if durable else 'NORMAL'}")
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield self._database
        except BaseException:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    def _select(self, condition: str, values: Sequence[object], order: str = "") -> list[Photograph]:
        query = f"SELECT {_COLUMNS} FROM photographs WHERE {condition} {order}"
        return [self._photograph(row) for row in self._database.execute(query, tuple(values))]

    def _photograph(self, row: tuple[object, ...]) -> Photograph:
        number, path, scene, name, digest, size, mtime, metadata, state, upload, offset, setbacks = row[:12]
        verdict, code, reason, hint, deleted = row[12:]
        refusal = None if code is None else Refusal(str(code), str(reason), str(hint or ""))
        return Photograph(
            *(number, self._read(path), scene, name, digest, size, mtime),  # type: ignore[arg-type]
            json.loads(str(metadata)),
            State(str(state)),
            *(upload, offset, setbacks, verdict),  # type: ignore[arg-type]
            refusal,
            bool(deleted),
        )

    def _stored(self, path: Path) -> bytes:
        """A path relative to the outbox where it is beside it: a card has another path elsewhere."""
        absolute = os.fsencode(path.parent.resolve() / path.name)
        below = self._folder.rstrip(b"/") + b"/"
        return absolute.removeprefix(below)

    def _read(self, stored: object) -> Path:
        assert isinstance(stored, bytes)
        return Path(os.fsdecode(os.path.join(self._folder, stored)))  # noqa: PTH118 -- bytes


def _columns(refusal: Refusal) -> tuple[str, str, str]:
    """``code``, ``reason`` and ``hint``; the reason may name a file whose name is no text."""
    return refusal.code, readable_name(refusal.reason), refusal.hint
