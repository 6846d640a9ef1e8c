"""Stops a running job: when it is canceled, when its turn ends, and when the disk is full."""

import contextlib
import time

from fvs_schema.jobs import Job, WaitReason
from fvs_schema.stages import Stage
from fvs_service.application import Storage
from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError, call
from fvs_service.host.protocol.messages import CancelJob
from fvs_service.host.worker.leased_scenes import LeasedScene
from fvs_service.host.worker.room import Room
from fvs_service.jobs.stages import stage_of_job
from fvs_service.jobs.work import Work

_STOP_S = 1.0
"""A runner that does not stop a canceled job within this time is killed: under 2 s with the polling."""
_SAVE_S = 60.0
"""Time within which a paused runner must save its checkpoint."""
_LOOK_EVERY_S = 0.5


class JobPausedError(Exception):
    """The job's turn has ended and it continues later; ``obstacle`` is what it lacks, if anything.

    ``needs`` is the work that another worker does next.
    """

    def __init__(self, obstacle: WaitReason | None = None, needs: Work | None = None) -> None:
        super().__init__()
        self.obstacle, self.needs = obstacle, needs


class CanceledError(Exception):
    """The job was canceled."""


class SupersededError(Exception):
    """The next update of the scene waits; the job's quick model is its result."""


class JobStop:
    """Why and since when a running job is being stopped, if it is.

    It is canceled by its flag, and paused when the disk comes to the reserve or when its turn ends. A turn
    ends only where little work is lost, and once the job has come farther than in its earlier turns: else it
    might never get past a long stage.

    ``may_be_superseded``: the quick model of an update is committed. The full one is not finished when the
    scene's next update waits, which trains a model of more images.
    """

    def __init__(self, storage: Storage, room: Room, scene: LeasedScene, job: Job) -> None:
        self._storage = storage
        self._room = room
        self._scene = scene
        self._job = job
        self._turn_may_end = False
        self._looked = time.monotonic()
        self._since = 0.0
        self.may_be_superseded = False
        self.reason: CanceledError | JobPausedError | SupersededError | None = None

    def came_to(self, progress: float, *, stage: Stage, new_stage: bool) -> None:
        """Record the job's progress; the beginning of a stage is a good moment to stop."""
        self._turn_may_end = progress > self._job.progress and (new_stage or stage_of_job(stage).trains)
        if new_stage:
            self._looked = 0.0

    def check(self) -> None:
        """Stop the job when there is a reason to; raises the reason when the runner does not stop in time."""
        found = self._new_reason()
        if found is not None:
            self.reason, self._since = found, time.monotonic()
            _request_stop(self._scene.endpoint)
        patience_s = _STOP_S if isinstance(self.reason, CanceledError) else _SAVE_S
        if self.reason is not None and time.monotonic() - self._since > patience_s:
            self._scene.child.kill()  # the lease stays, so that the job's end can be recorded
            raise self.reason

    def _new_reason(self) -> "CanceledError | JobPausedError | SupersededError | None":
        if isinstance(self.reason, CanceledError):
            return None
        if self._storage.ledger.cancel_requested(self._job.id):
            return CanceledError()
        if self.reason is not None or time.monotonic() - self._looked < _LOOK_EVERY_S:
            return None
        self._looked = time.monotonic()
        if self._room.used_up:
            return JobPausedError(WaitReason.DISK)
        if self.may_be_superseded and self._storage.queue.update_waits(self._job.scene_id):
            return SupersededError()
        if self._storage.queue.must_pause(self._job.id, turn_may_end=self._turn_may_end):
            return JobPausedError()
        return None


def _request_stop(endpoint: str) -> None:
    with contextlib.suppress(RunnerGoneError, RunnerError):  # a runner that does not stop is killed
        call(endpoint, CancelJob(), _STOP_S)
