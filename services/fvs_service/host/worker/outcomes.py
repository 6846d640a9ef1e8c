"""The outcomes of starting an attempt at a job, and the outcome that each error leads to.

In its turn of a job a worker starts the attempt on the scene's runner, which comes to an outcome. The steps
of recovery, each for what the one before it does not mend:

1. Structure from motion crashes: the engine searches for the image that is at fault
   (``fvs_engine.sfm.culprit``), the worker quarantines it, and the attempt goes on without it.
2. A process died: the attempt starts again in the same turn, from its last checkpoint (``StartAgain``).
3. Memory or disk space is lacking, or it is the turn of other jobs: the attempt goes on in a later turn
   (``Paused``), or on another host of its scene (``LeftToAnother``).
4. There is no progress in ``turns.MAX_STARTS`` starts: the attempt fails (``Failed``); a client may retry it.
"""

from dataclasses import dataclass
from typing import TypeAlias

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_schema.jobs import JobFailure, WaitReason
from fvs_service.errors import NotFoundError, OutOfSpaceError, StaleLeaseError, StorageUnavailableError
from fvs_service.host.protocol.connection import RunnerGoneError
from fvs_service.host.worker.leased_scenes import NoMemoryError
from fvs_service.jobs.stages import Work

_PAUSE_S = 0.5
_STORAGE_PAUSE_S = 2.0
"""Time between two starts while the database or the object store cannot be reached."""

_log = structlog.get_logger()


@dataclass(frozen=True)
class Succeeded:
    """Its snapshot is committed.

    ``superseded``: it is the quick model, because the scene's next update waits and makes a better one.
    """

    superseded: bool = False


@dataclass(frozen=True)
class Failed:
    """Another start would fail too."""

    error: JobFailure


@dataclass(frozen=True)
class Canceled:
    """It was stopped on a client's request."""


@dataclass(frozen=True)
class Paused:
    """The turn ends, and the attempt goes on in its next one; ``obstacle`` is what it lacks, if anything."""

    obstacle: WaitReason | None = None
    reason: str = "The disk is full."


@dataclass(frozen=True)
class LeftToAnother:
    """The turn ends: another host of the scene, which does this work, goes on."""

    work: Work


@dataclass(frozen=True)
class StartAgain:
    """The attempt starts again in this turn, after ``pause_s`` (None: a pause that grows with every start).

    ``at_fault``: the job may have caused this, and the start counts.
    """

    reason: str
    at_fault: bool = True
    pause_s: float | None = None


Outcome: TypeAlias = Succeeded | Failed | Canceled | Paused | LeftToAnother | StartAgain


def outcome_of(error: Exception) -> Outcome:
    """What an error means for the attempt: its runner or the database died, or there is a defect."""
    match error:
        case NoMemoryError():
            return Paused(WaitReason.MEMORY)
        case OutOfSpaceError():
            return Paused(WaitReason.DISK, error.message)
        case StaleLeaseError():
            return StartAgain(error.message, at_fault=False, pause_s=_PAUSE_S)
        case StorageUnavailableError():
            return StartAgain(error.message, at_fault=False, pause_s=_STORAGE_PAUSE_S)
        case RunnerGoneError() | NotFoundError():  # the scene was deleted
            return StartAgain(str(error))
    _log.exception("start failed", exc_info=error)
    return StartAgain(type(error).__name__, at_fault=not isinstance(error, SQLAlchemyError))
