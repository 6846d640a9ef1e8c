"""Turns of jobs: in a turn the attempt is started, again and again if need be, until it has an outcome."""

import time

import structlog

from fvs_schema.jobs import JobFailure, WaitReason
from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, OutOfSpaceError, StorageUnavailableError
from fvs_service.host.worker.attempts import Attempts, record_end
from fvs_service.host.worker.leased_scenes import LeasedScenes
from fvs_service.host.worker.outcomes import (
    Canceled,
    Failed,
    LeftToAnother,
    Outcome,
    Paused,
    StartAgain,
    outcome_of,
)
from fvs_service.host.worker.resources import Room, job_need_bytes
from fvs_service.host.worker.starts import Starts
from fvs_service.images.repository import usable_images
from fvs_service.jobs.repository import find_job
from fvs_service.jobs.states import Turn

MAX_STARTS = 6
"""An attempt fails after this many starts without progress."""
_PAUSE_S = 0.5
_MEMORY_PATIENCE_S = 5.0
"""Time to wait for memory before the turn goes to another job."""

_log = structlog.get_logger()


class Turns:
    """Runs the turns of one worker's jobs, in any thread; the same one may be run again after a crash."""

    def __init__(
        self, storage: Storage, scenes: LeasedScenes, worker_id: str, room: Room, *, trains: bool = True
    ) -> None:
        self._storage = storage
        self._scenes = scenes
        self._worker_id = worker_id
        self._room = room
        self._attempts = Attempts(storage, scenes, room, trains=trains)

    def run(self, turn: Turn) -> WaitReason | None:
        """Run a turn until it or the attempt ends; returns the resource that the job lacks, if any."""
        with structlog.contextvars.bound_contextvars(
            worker=self._worker_id, scene=turn.scene_id, job=turn.job_id
        ):
            starts = Starts(self._storage.database, turn)
            while not self._over(turn) and not self._scenes.stopping:
                match self._outcome(turn, starts):
                    case StartAgain() as again:
                        self._pause(turn, starts, again)
                    case Paused(obstacle):
                        return obstacle
                    case _:
                        return None
            return None

    def _outcome(self, turn: Turn, starts: Starts) -> Outcome:
        """End the attempt where no runner is needed for that, else start it."""
        try:
            if self._storage.ledger.cancel_requested(turn.job_id):
                return self._end(turn, Canceled())
            if starts.without_progress(self._progress(turn)) >= MAX_STARTS:
                return self._end(turn, _given_up(starts))
            if self._room.used_up:
                return Paused(WaitReason.DISK)
            return self._start(turn, starts)
        except Exception as error:
            return outcome_of(error)

    def _start(self, turn: Turn, starts: Starts) -> Outcome:
        """Start the attempt; the start counts unless what ended it is not the job's fault."""
        starts.begin(self._progress(turn))
        try:
            outcome = self._on_runner(turn)
        except Exception as error:
            outcome = outcome_of(error)
        match outcome:
            case Paused(WaitReason.DISK, reason):
                starts.because(reason, disk_full=True)
            case StartAgain(reason, at_fault=True) if not self._scenes.stopping:
                starts.because(reason)
            case Paused() | LeftToAnother() | StartAgain():
                starts.excuse()
        return outcome

    def _on_runner(self, turn: Turn) -> Outcome:
        with self._storage.database.reading() as session:
            request = find_job(session, turn.job_id).request
            images = usable_images(session, turn.scene_id)
        need = job_need_bytes(request, images, self._storage.settings.worker)
        with self._scenes.with_runner(
            turn.scene_id, need, lambda: self._unwanted(turn), _MEMORY_PATIENCE_S
        ) as scene:
            if scene is not None:
                job = self._storage.ledger.start(scene.lease, turn.job_id, turn.attempt)
                if job is not None:
                    return self._attempts.start(scene, job, turn.traceparent)
        return StartAgain("It is not wanted any longer.", at_fault=False, pause_s=0.0)

    def _end(self, turn: Turn, outcome: Canceled | Failed) -> Outcome:
        """End the attempt between two starts, for which no runner is needed."""
        with self._scenes.without_runner(turn.scene_id, lambda: self._over(turn)) as lease:
            if lease is not None:
                job = self._storage.ledger.start(lease, turn.job_id, turn.attempt)
                if job is not None:
                    record_end(self._storage.ledger, lease, job, outcome)
        return outcome

    def _pause(self, turn: Turn, starts: Starts, again: StartAgain) -> None:
        count = starts.without_progress(self._progress(turn))
        _log.warning("starting again", starts=count, reason=again.reason)
        pause_s = again.pause_s
        if pause_s is None:
            # The first time without a pause, so that no other worker leases the scene.
            pause_s = _PAUSE_S * (count - 1) if count else _PAUSE_S
        time.sleep(pause_s)

    def _over(self, turn: Turn) -> bool:
        """Whether the attempt has ended, a later one has begun, or it is no longer this worker's."""
        try:
            return not self._storage.queue.has(turn)
        except StorageUnavailableError:
            _log.warning("database unavailable")
            time.sleep(_PAUSE_S)
            return False

    def _unwanted(self, turn: Turn) -> bool:
        """Whether the turn is over or the attempt is to be canceled."""
        return self._over(turn) or self._storage.ledger.cancel_requested(turn.job_id)

    def _progress(self, turn: Turn) -> float:
        """The job's progress; 0 while the database is unavailable, and of a deleted job."""
        try:
            with self._storage.database.reading() as session:
                return find_job(session, turn.job_id).progress
        except (StorageUnavailableError, NotFoundError):
            return 0.0


def _given_up(starts: Starts) -> Failed:
    """The end of an attempt that makes no progress."""
    hint = "Most often memory ran out: use fewer or smaller images, or a machine with more memory."
    if starts.disk_full:
        hint = "Free some space on the service's disk, then retry the job."
    return Failed(
        JobFailure(
            code=OutOfSpaceError.code if starts.disk_full else "runner-died",
            message=f"The job stopped {MAX_STARTS} times without progress: {starts.reason}",
            hint=hint,
            retryable=True,
            stage=None,
        )
    )
