"""The job engine of the service: DBOS' queues, and the worker that takes from them."""

import os
import signal
import threading

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_service.application import Storage
from fvs_service.errors import ServiceError
from fvs_service.jobs.port import JobTicket
from fvs_service.jobs.service import Jobs
from fvs_service.worker.attempt import Attempts
from fvs_service.worker.host import Host
from fvs_service.worker.presence import Presence
from fvs_service.worker.queue import Queue, take_jobs

_TEND_S = 2.0
_FORGET_S = 600.0

_EXIT_TAKEN_FOR_DEAD = 5

_log = structlog.get_logger()


class _TakenForDeadError(Exception):
    """The others took this worker for dead, and go on with its jobs."""


class DbosEngine:
    """See ``JobEngine``."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self._queue = Queue(storage.settings.queue)

    def submit(self, ticket: JobTicket) -> None:
        """See ``JobEngine``."""
        self._queue.submit(ticket)

    def request_cancel(self, ticket: JobTicket) -> None:
        """See ``JobEngine``."""
        self._queue.request_cancel(ticket)

    def run_worker(self, worker_id: str) -> None:
        """See ``JobEngine``; to be called in the main thread of a process of its own."""
        stop = threading.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: stop.set())
        settings = self._storage.settings
        # At once, or others might still take over what this worker's last life left, and it goes on with.
        presence = Presence(self._storage.database, settings.lease_s)
        presence.show(worker_id)
        host = Host(self._storage, worker_id)
        attempts = Attempts(self._storage, host)
        stop_taking = take_jobs(
            settings.queue,
            worker_id,
            attempts.run,
            host.warm,
            jobs_at_once=settings.worker.jobs_at_once,
            poll_s=settings.worker.queue_poll_s,
        )
        _log.info("worker ready", worker=worker_id)
        try:
            self._tend(worker_id, presence, stop)
        except _TakenForDeadError:
            _log.warning("another worker took over", worker=worker_id)
            os._exit(_EXIT_TAKEN_FOR_DEAD)  # at once: what is under way here is done elsewhere
        finally:
            host.stop()
            stop_taking()
            self._queue.close()

    def reap(self, worker_id: str) -> int:
        """See ``JobEngine``."""
        return self._queue.resume(worker_id)

    def _tend(self, worker_id: str, presence: Presence, stop: threading.Event) -> None:
        """Until asked to stop: show that the worker lives, and see to what others left lying.

        Raises ``_TakenForDeadError`` when others did the same with what this one left.
        """
        jobs = Jobs(self._storage.database, self, self._storage.settings.limits)
        forget_in_s = _FORGET_S
        while not stop.wait(_TEND_S):
            try:
                if not presence.show(worker_id):
                    raise _TakenForDeadError
                for dead in presence.take_dead(worker_id):
                    _log.warning("reaping", worker=dead, jobs=self.reap(dead))
                    presence.forget(dead)
                jobs.submit_waiting()
                forget_in_s -= _TEND_S
                if forget_in_s <= 0:
                    self._queue.forget_finished()
                    forget_in_s = _FORGET_S
            except (SQLAlchemyError, ServiceError) as error:
                _log.warning("database unavailable", reason=str(error))
