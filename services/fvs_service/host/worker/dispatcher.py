"""The dispatcher of a worker: it takes jobs while slots are free, and runs each in a thread of its own."""

import threading
from collections.abc import Callable

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_schema.jobs import WaitReason
from fvs_service.errors import ServiceError
from fvs_service.host.worker.runners import RunnerRequests
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.states import Turn

_STOP_S = 1.0
_AFTER_ERROR_S = 0.5
_log = structlog.get_logger()

RunJob = Callable[[Turn], WaitReason | None]
"""Runs a job's turn; returns the resource that the job lacked, if any."""


class Dispatcher:
    """Runs the jobs of a worker and starts the runners that rankings need, until it is stopped.

    The jobs that the worker has taken and does not run come first: those of its predecessor of the same name,
    those that could not be put back because the database was unavailable, and those whose next turn it took
    before the thread of the last one ended. ``has_room`` returns whether a job may start now. It looks for
    jobs and requests when it is woken, and every ``poll_s``.
    """

    def __init__(
        self,
        worker_id: str,
        queue: JobQueue,
        requests: RunnerRequests,
        run_job: RunJob,
        start_runner: Callable[[str], None],
        *,
        slots: int,
        starts_at_once: int,
        poll_s: float,
        has_room: Callable[[], bool],
    ) -> None:
        self._worker_id = worker_id
        self._queue = queue
        self._requests = requests
        self._run_job = run_job
        self._start_runner = start_runner
        self._slots, self._starts_at_once = slots, starts_at_once
        self._poll_s = poll_s
        self._has_room = has_room
        self._lock = threading.Lock()
        self._running: set[str] = set()
        self._starting = 0
        self._stopping = threading.Event()
        self._woken = threading.Event()
        self._woken.set()
        self._thread = threading.Thread(target=self._dispatch, daemon=True)

    def start(self) -> None:
        """Start to take jobs."""
        self._thread.start()

    def stop(self) -> None:
        """Take no more jobs; running ones continue."""
        self._stopping.set()
        self.wake()
        self._thread.join(_STOP_S)  # it may be waiting for the database

    def wake(self) -> None:
        """Look for jobs and requests now. Callable from any thread."""
        self._woken.set()

    def _dispatch(self) -> None:
        pause_s = self._poll_s
        while True:
            self._woken.wait(pause_s)
            self._woken.clear()
            if self._stopping.is_set():
                return
            pause_s = self._poll_s if self._look() else min(_AFTER_ERROR_S, self._poll_s)

    def _look(self) -> bool:
        """Start jobs and runners that are queued; return whether the database could be reached."""
        try:
            self._dispatch_jobs()
            self._dispatch_runners()
        except (SQLAlchemyError, ServiceError) as error:
            _log.warning("no jobs can be taken", reason=type(error).__name__)
        except Exception:  # a worker that sends heartbeats and takes no jobs would go unnoticed
            _log.exception("no jobs can be taken")
        else:
            return True
        return False

    def _dispatch_jobs(self) -> None:
        for turn in self._queue.taken_by(self._worker_id):
            self._begin(turn)
        while len(self._running) < self._slots and self._has_room():
            taken = self._queue.take(self._worker_id)
            if taken is None:
                return
            self._begin(taken)

    def _begin(self, turn: Turn) -> None:
        with self._lock:
            if turn.attempt_id in self._running:
                return
            self._running.add(turn.attempt_id)
        threading.Thread(target=self._run, args=(turn,), daemon=True, name=turn.attempt_id).start()

    def _run(self, turn: Turn) -> None:
        try:
            obstacle = self._run_job(turn)
            if not self._stopping.is_set():  # else the next process of this worker resumes the job
                self._queue.put_back(turn, obstacle)
        except (SQLAlchemyError, ServiceError) as error:
            _log.warning("the job cannot be put back yet", job=turn.job_id, reason=type(error).__name__)
            self._stopping.wait(_AFTER_ERROR_S)
        except Exception:
            _log.exception("a job's turn failed", job=turn.job_id)
            self._stopping.wait(_AFTER_ERROR_S)
        finally:
            with self._lock:
                self._running.discard(turn.attempt_id)
            self.wake()

    def _dispatch_runners(self) -> None:
        while self._starting < self._starts_at_once:
            scene_id = self._requests.take()
            if scene_id is None:
                return
            with self._lock:
                self._starting += 1
            threading.Thread(target=self._start, args=(scene_id,), daemon=True).start()

    def _start(self, scene_id: str) -> None:
        try:
            self._start_runner(scene_id)
        except Exception:
            _log.exception("a runner cannot be started", scene=scene_id)
        finally:
            with self._lock:
                self._starting -= 1
            self.wake()
