"""Turns of attempts at jobs: a new try after a process died, a failure after too many without progress."""

import time

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_schema.jobs import JobFailure, WaitReason
from fvs_service.application import Storage
from fvs_service.errors import (
    NotFoundError,
    OutOfSpaceError,
    StaleLeaseError,
    StorageUnavailableError,
)
from fvs_service.host.protocol.connection import RunnerGoneError
from fvs_service.host.worker.job_run import ChildDiedError, JobRuns
from fvs_service.host.worker.job_stop import JobPausedError
from fvs_service.host.worker.leased_scenes import LeasedScenes, NoMemoryError
from fvs_service.host.worker.memory import job_need_bytes
from fvs_service.host.worker.room import Room
from fvs_service.host.worker.tries import Tries
from fvs_service.images.repository import usable_images
from fvs_service.jobs.repository import find_job
from fvs_service.jobs.states import Turn

MAX_TRIES = 6
"""An attempt fails after this many tries without progress."""
_PAUSE_S = 0.5
_STORAGE_PAUSE_S = 2.0
"""Time between two tries while the database or the object store cannot be reached."""
_MEMORY_PATIENCE_S = 5.0
"""Time to wait for memory before the turn goes to another job."""

_log = structlog.get_logger()


class Attempts:
    """Runs attempts for one worker, in any thread; the same one may be run again after a crash."""

    def __init__(self, storage: Storage, scenes: LeasedScenes, worker_id: str, room: Room) -> None:
        self._storage = storage
        self._scenes = scenes
        self._worker_id = worker_id
        self._room = room
        self._runs = JobRuns(storage, scenes, room)

    def run(self, turn: Turn) -> WaitReason | None:
        """Run an attempt to its end, or that of its turn; returns the resource that it lacks, if any.

        When a process dies there is a new try. The attempt fails after ``MAX_TRIES`` tries without progress.
        """
        with structlog.contextvars.bound_contextvars(
            worker=self._worker_id, scene=turn.scene_id, job=turn.job_id
        ):
            return self._run(turn)

    def _run(self, turn: Turn) -> WaitReason | None:
        tries = Tries(self._storage.settings.scenes / turn.scene_id, turn)
        while not self._over(turn) and not self._scenes.stopping:
            try:
                if self._storage.ledger.cancel_requested(turn.job_id):
                    self._cancel(turn)
                elif tries.without_progress(self._progress(turn)) >= MAX_TRIES:
                    self._give_up(turn, tries)
                elif self._room.used_up:
                    return WaitReason.DISK
                else:
                    self._try(turn, tries)
            except NoMemoryError:
                tries.excuse()
                return WaitReason.MEMORY
            except JobPausedError as paused:
                if paused.obstacle is WaitReason.DISK:
                    tries.because("The disk is full.", disk_full=True)
                else:
                    tries.excuse()
                return paused.obstacle
            except StaleLeaseError:
                tries.excuse()
                _log.warning("lease lost")
                time.sleep(_PAUSE_S)
            except StorageUnavailableError as error:
                tries.excuse()
                _log.warning("storage unavailable", reason=error.message)
                time.sleep(_STORAGE_PAUSE_S)
            except OutOfSpaceError as error:
                tries.because(error.message, disk_full=True)
                return WaitReason.DISK
            except Exception as error:  # the runner or the database died, or there is a defect: try again
                if isinstance(error, NotFoundError) and self._over(turn):
                    return None  # the scene was deleted
                reason = str(error)
                if not isinstance(error, RunnerGoneError | ChildDiedError):
                    reason = type(error).__name__
                    _log.exception("try failed")
                tries.because(reason)
                if self._scenes.stopping or isinstance(error, SQLAlchemyError):
                    tries.excuse()
                count = tries.without_progress(self._progress(turn))
                _log.warning("trying again", tries=count, reason=reason)
                # The first time without a pause, so that no other worker leases the scene.
                time.sleep(_PAUSE_S * (count - 1) if count else _PAUSE_S)
        return None

    def _over(self, turn: Turn) -> bool:
        """Whether the attempt has ended, a later one has begun, or it is no longer this worker's."""
        try:
            return not self._storage.queue.has(turn)
        except StorageUnavailableError:
            _log.warning("database unavailable")
            time.sleep(_PAUSE_S)
            return False

    def _unwanted(self, turn: Turn) -> bool:
        """Whether the attempt is over or is to be canceled."""
        return self._over(turn) or self._storage.ledger.cancel_requested(turn.job_id)

    def _progress(self, turn: Turn) -> float:
        """The job's progress; 0 while the database is unavailable, and of a deleted job."""
        try:
            with self._storage.database.reading() as session:
                return find_job(session, turn.job_id).progress
        except (StorageUnavailableError, NotFoundError):
            return 0.0

    def _try(self, turn: Turn, tries: Tries) -> None:
        tries.start(self._progress(turn))
        with self._storage.database.reading() as session:
            request = find_job(session, turn.job_id).request
            images = usable_images(session, turn.scene_id)
        need = job_need_bytes(request, images, self._storage.settings.worker)
        with self._scenes.with_runner(
            turn.scene_id, need, lambda: self._unwanted(turn), _MEMORY_PATIENCE_S
        ) as scene:
            if scene is None:
                tries.excuse()
                return
            job = self._storage.ledger.start(scene.lease, turn.job_id, turn.attempt)
            if job is not None:
                self._runs.run(scene, job, turn.traceparent)

    def _cancel(self, turn: Turn) -> None:
        """Cancel an attempt between two tries, for which no runner is needed."""
        with self._scenes.without_runner(turn.scene_id, lambda: self._over(turn)) as lease:
            if lease is not None and self._storage.ledger.start(lease, turn.job_id, turn.attempt) is not None:
                self._storage.ledger.cancel(lease, turn.job_id)

    def _give_up(self, turn: Turn, tries: Tries) -> None:
        """Fail an attempt that makes no progress."""
        with self._scenes.without_runner(turn.scene_id, lambda: self._over(turn)) as lease:
            if lease is None:
                return
            job = self._storage.ledger.start(lease, turn.job_id, turn.attempt)
            if job is None:
                return
            full = tries.disk_full
            error = JobFailure(
                code=OutOfSpaceError.code if full else "runner-died",
                message=f"The job stopped {MAX_TRIES} times without progress: {tries.reason}",
                hint="Free some space on the service's disk, then retry the job."
                if full
                else "Most often memory ran out: use fewer or smaller images, or a machine with more memory.",
                retryable=True,
                stage=job.stage,
            )
            self._storage.ledger.fail(lease, job.id, error)
