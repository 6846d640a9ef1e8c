"""The job engine of the service: DBOS' queues, and the worker that runs their jobs."""

import os
import signal
import threading

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_service.application import Storage
from fvs_service.errors import ServiceError
from fvs_service.jobs.port import JobTicket
from fvs_service.jobs.service import Jobs
from fvs_service.worker.attempts import Attempts
from fvs_service.worker.heartbeat import Heartbeats
from fvs_service.worker.leased_scenes import LeasedScenes
from fvs_service.worker.queue import Queue, take_jobs
from fvs_service.worker.sweep import Sweeps

_HEARTBEAT_S = 2.0
_FORGET_S = 600.0

_EXIT_REPLACED = 5

_log = structlog.get_logger()


class _ReplacedError(Exception):
    """Another worker has declared this one dead and requeued its jobs."""


class DbosEngine:
    """The ``JobEngine`` on DBOS."""

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
        # First of all: else others might requeue the jobs that this worker is about to resume.
        heartbeats = Heartbeats(self._storage.database, settings.lease_s)
        heartbeats.beat(worker_id)
        scenes = LeasedScenes(self._storage, worker_id)
        attempts = Attempts(self._storage, scenes)
        stop_taking = take_jobs(
            settings.queue,
            worker_id,
            attempts.run,
            scenes.start_runner,
            jobs_at_once=settings.worker.jobs_at_once,
            poll_s=settings.worker.queue_poll_s,
        )
        sweeps = Sweeps(self._storage)
        sweeps.start()
        _log.info("worker ready", worker=worker_id)
        try:
            self._maintain(worker_id, heartbeats, stop)
        except _ReplacedError:
            _log.warning("replaced by another worker", worker=worker_id)
            os._exit(_EXIT_REPLACED)  # at once: its jobs run elsewhere
        finally:
            sweeps.stop()
            scenes.stop()
            stop_taking()
            self._queue.close()

    def reap(self, worker_id: str) -> int:
        """See ``JobEngine``."""
        return self._queue.resume(worker_id)

    def _maintain(self, worker_id: str, heartbeats: Heartbeats, stop: threading.Event) -> None:
        """Until ``stop``: send heartbeats, requeue the jobs of dead workers, submit unsubmitted jobs.

        Raises ``_ReplacedError`` when another worker has requeued the jobs of this one.
        """
        jobs = Jobs(self._storage.database, self, self._storage.settings.limits)
        forget_in_s = _FORGET_S
        while not stop.wait(_HEARTBEAT_S):
            try:
                if not heartbeats.beat(worker_id):
                    raise _ReplacedError
                for dead in heartbeats.claim_dead(worker_id):
                    _log.warning("reaping", worker=dead, jobs=self.reap(dead))
                    heartbeats.forget(dead)
                jobs.submit_unsubmitted()
                forget_in_s -= _HEARTBEAT_S
                if forget_in_s <= 0:
                    self._queue.forget_finished()
                    forget_in_s = _FORGET_S
            except (SQLAlchemyError, ServiceError) as error:
                _log.warning("database unavailable", reason=str(error))
