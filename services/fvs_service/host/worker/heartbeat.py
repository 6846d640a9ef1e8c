"""Heartbeats of workers: they show which workers are alive, so that others take over the jobs of dead ones.

A worker that was only frozen finds at its next heartbeat that it was declared dead.
"""

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import ColumnElement, delete, insert, select, update

from fvs_service.jobs.fleet import MISSED_LEASES
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow, columns_of

_WORKERS = columns_of(WorkerRow)


@dataclass(frozen=True)
class Heartbeat:
    """What the database answers to a heartbeat.

    ``known``: it knew the worker, and no other has declared it dead. ``dead``: the ids of dead workers; each
    goes to one caller only, unless that one dies too. The caller puts back their jobs, then calls ``forget``.
    """

    known: bool
    dead: tuple[str, ...]


class Heartbeats:
    """Records the heartbeats of one worker; times are the database's."""

    def __init__(
        self,
        database: Database,
        worker_id: str,
        lease_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._database, self._worker_id, self._clock = database, worker_id, clock
        self._duration_ms = round(MISSED_LEASES * lease_s * 1000)
        self._last_beat = -math.inf

    def beat(
        self,
        *,
        slots: int = 1,
        disk_full: bool = False,
        backend: str = "auto",
        runner_bytes: int = 0,
    ) -> Heartbeat:
        """Record that this worker is alive, and claim the dead ones unless it was silent for as long itself.

        ``slots``: the number of jobs that it runs at once; ``disk_full``: it takes none for lack of room;
        ``runner_bytes``: the resident memory of its runners.
        """
        state = {
            "slots": slots,
            "disk_full": disk_full,
            "backend": backend,
            "runner_bytes": runner_bytes,
            "beaten_at_ms": now_ms(),
            "expires_at_ms": now_ms() + self._duration_ms,
        }
        silent = _WORKERS.c.expires_at_ms < now_ms()
        # One transaction, unless a worker is dead: it is most of what an idle worker does.
        with self._database.writing() as session:
            known = session.scalar(
                update(_WORKERS)
                .where(_WORKERS.c.id == self._worker_id)
                .values(state)
                .returning(_WORKERS.c.id)
            )
            if known is None:
                session.execute(insert(_WORKERS).values(id=self._worker_id, **state))
            dead = session.scalar(select(_WORKERS.c.id).where(silent).limit(1)) is not None
        now = self._clock()
        # After a failure of the database all workers were silent, and the others may be alive, too.
        regular = now - self._last_beat < self._duration_ms / 1000
        self._last_beat = now
        return Heartbeat(known is not None, self._claim(silent) if dead and regular else ())

    def _claim(self, silent: ColumnElement[bool]) -> tuple[str, ...]:
        """Claim dead workers. Those that another worker is claiming, or that beat again, are left out."""
        free = select(_WORKERS.c.id).where(silent).with_for_update(skip_locked=True)
        with self._database.writing() as session:
            claimed = session.scalars(
                update(_WORKERS)
                .where(_WORKERS.c.id.in_(free))
                .values(expires_at_ms=now_ms() + self._duration_ms)
                .returning(_WORKERS.c.id)
            )
            return tuple(claimed)

    def forget(self, worker_id: str) -> None:
        """Delete the row of a dead worker, after its jobs were put back."""
        with self._database.writing() as session:
            session.execute(delete(_WORKERS).where(_WORKERS.c.id == worker_id))


def touch_heartbeat(file: Path) -> None:
    """Set the time of a worker's heartbeat file, by which a probe sees that it is alive and not frozen.

    Without effect where it cannot be written.
    """
    with contextlib.suppress(OSError):  # a full disk does not end a worker
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()


def forget_heartbeats(folder: Path) -> None:
    """Delete the files of earlier workers, whose number or names may have been different."""
    with contextlib.suppress(FileNotFoundError):
        for file in folder.iterdir():
            file.unlink()
