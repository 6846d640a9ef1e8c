"""Attempts at jobs: a new try after a process died, a failure after too many tries without progress."""

import threading
import time

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, StaleLeaseError
from fvs_service.images.repository import accepted_images
from fvs_service.jobs.model import JobError
from fvs_service.jobs.port import JobTicket
from fvs_service.jobs.repository import find_job
from fvs_service.worker.job_run import ChildDiedError, JobPausedError, JobRuns
from fvs_service.worker.leased_scenes import LeasedScenes
from fvs_service.worker.memory import job_need_bytes
from fvs_service.worker.protocol.connection import RunnerGoneError
from fvs_service.worker.scene_slots import SceneSlots
from fvs_service.worker.tries import Tries

MAX_TRIES = 6
"""An attempt fails after this many tries without progress."""
_PAUSE_S = 0.5

_log = structlog.get_logger()


class Attempts:
    """Runs attempts; any thread may run one, and the same one may be run again after a crash."""

    def __init__(self, storage: Storage, scenes: LeasedScenes) -> None:
        self._storage = storage
        self._scenes = scenes
        self._slots = SceneSlots()
        self._runs = JobRuns(storage, scenes, self._slots)

    def run(self, ticket: JobTicket) -> None:
        """Run an attempt to its end, with a new try whenever a process dies.

        It fails after ``MAX_TRIES`` tries without progress.
        """
        tries = Tries(self._storage.settings.scenes / ticket.scene_id, ticket)
        reason = "its worker died"
        while not self._ended(ticket):
            if self._scenes.stopping:
                threading.Event().wait()  # until the process ends; the next one runs the attempt again
            try:
                if self._storage.ledger.cancel_requested(ticket.job_id):
                    self._cancel(ticket)
                elif tries.without_progress(self._progress(ticket)) >= MAX_TRIES:
                    self._give_up(ticket, reason)
                elif self._slots.acquire(ticket.scene_id, ticket.kind, lambda: self._unwanted(ticket)):
                    try:
                        self._try(ticket, tries)
                    finally:
                        self._slots.release(ticket.scene_id)
            except JobPausedError:
                tries.excuse()
                time.sleep(_PAUSE_S)
            except StaleLeaseError:
                tries.excuse()
                _log.warning("lease lost", job=ticket.job_id)
                time.sleep(_PAUSE_S)
            except Exception as error:  # the runner or the database died, or there is a defect: try again
                if isinstance(error, NotFoundError) and self._ended(ticket):
                    return  # the scene was deleted
                reason = str(error)
                if not isinstance(error, RunnerGoneError | ChildDiedError):
                    reason = f"{type(error).__name__}: {error}"
                    _log.exception("try failed", job=ticket.job_id)
                if self._scenes.stopping or isinstance(error, SQLAlchemyError):
                    tries.excuse()
                count = tries.without_progress(self._progress(ticket))
                _log.warning("trying again", job=ticket.job_id, tries=count, reason=reason)
                # The first time without a pause, so that no other worker leases the scene.
                time.sleep(_PAUSE_S * (count - 1) if count else _PAUSE_S)

    def _ended(self, ticket: JobTicket) -> bool:
        """Whether the job has ended, or a later attempt has started."""
        try:
            with self._storage.database.reading() as session:
                job = find_job(session, ticket.job_id)
        except NotFoundError:
            return True
        except SQLAlchemyError:
            _log.warning("database unavailable", job=ticket.job_id)
            time.sleep(_PAUSE_S)
            return False
        return job.state.ended or job.attempt != ticket.attempt

    def _unwanted(self, ticket: JobTicket) -> bool:
        """Whether the attempt has ended or is to be canceled."""
        return self._ended(ticket) or self._storage.ledger.cancel_requested(ticket.job_id)

    def _progress(self, ticket: JobTicket) -> float:
        """The job's progress; 0 while the database is unavailable, and of a deleted job."""
        try:
            with self._storage.database.reading() as session:
                return find_job(session, ticket.job_id).progress
        except (SQLAlchemyError, NotFoundError):
            return 0.0

    def _try(self, ticket: JobTicket, tries: Tries) -> None:
        tries.start(self._progress(ticket))
        with self._storage.database.reading() as session:
            request = find_job(session, ticket.job_id).request
            images = accepted_images(session, ticket.scene_id)
        need = job_need_bytes(request, images, self._storage.settings.worker)
        with self._scenes.with_runner(ticket.scene_id, need, lambda: self._unwanted(ticket)) as scene:
            if scene is None:
                tries.excuse()
                return
            job = self._storage.ledger.start(scene.lease, ticket.job_id, ticket.attempt)
            if job is not None:
                self._runs.run(scene, job)

    def _cancel(self, ticket: JobTicket) -> None:
        """Cancel an attempt between two tries, for which no runner is needed."""
        with self._scenes.without_runner(ticket.scene_id, lambda: self._ended(ticket)) as lease:
            if (
                lease is not None
                and self._storage.ledger.start(lease, ticket.job_id, ticket.attempt) is not None
            ):
                self._storage.ledger.cancel(lease, ticket.job_id)

    def _give_up(self, ticket: JobTicket, reason: str) -> None:
        """Fail an attempt that makes no progress; ``reason`` is why the last try ended."""
        with self._scenes.without_runner(ticket.scene_id, lambda: self._ended(ticket)) as lease:
            if lease is None:
                return
            job = self._storage.ledger.start(lease, ticket.job_id, ticket.attempt)
            if job is None:
                return
            error = JobError(
                code="runner-died",
                message=f"The job stopped {MAX_TRIES} times without progress: {reason}",
                hint="Often memory ran out: use fewer or smaller images, or a machine with more memory.",
                retryable=True,
                stage=job.stage,
            )
            self._storage.ledger.fail(lease, job.id, error)
