"""Stops a running job: when it is canceled, when its turn ends, and when the disk is full."""

import contextlib
import time

from fvs_schema.jobs import Job, WaitReason
from fvs_schema.stages import Stage
from fvs_service.application import Storage
from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError, call
from fvs_service.host.protocol.messages import CancelJob
from fvs_service.host.worker.leased_scenes import LeasedScene
from fvs_service.host.worker.outcomes import Canceled, Paused, Succeeded
from fvs_service.host.worker.resources import Room
from fvs_service.jobs.stages import stage_of_job

_STOP_S = 1.0
"""A runner that does not stop a canceled job within this time is killed: under 2 s with the polling."""
_SAVE_S = 60.0
"""Time within which a paused runner must save its checkpoint."""
_LOOK_EVERY_S = 0.5


class JobStop:
    """Decides when a running job is stopped, and with which ``outcome`` (None: it goes on).

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
        self.outcome: Canceled | Paused | Succeeded | None = None

    def came_to(self, progress: float, *, stage: Stage, new_stage: bool) -> None:
        """Record the job's progress; the beginning of a stage is a good moment to stop."""
        self._turn_may_end = progress > self._job.progress and (new_stage or stage_of_job(stage).trains)
        if new_stage:
            self._looked = 0.0

    def check(self) -> bool:
        """Stop the job when there is a reason to; kills a runner that does not in time, and returns True."""
        found = self._new_outcome()
        if found is not None:
            self.outcome, self._since = found, time.monotonic()
            with contextlib.suppress(RunnerGoneError, RunnerError):  # a runner that does not stop is killed
                call(self._scene.endpoint, CancelJob(), _STOP_S)
        patience_s = _STOP_S if isinstance(self.outcome, Canceled) else _SAVE_S
        if self.outcome is None or time.monotonic() - self._since <= patience_s:
            return False
        self._scene.child.kill()  # the lease stays, so that the job's end can be recorded
        return True

    def _new_outcome(self) -> Canceled | Paused | Succeeded | None:
        if isinstance(self.outcome, Canceled):
            return None
        if self._storage.ledger.cancel_requested(self._job.id):
            return Canceled()
        if self.outcome is not None or time.monotonic() - self._looked < _LOOK_EVERY_S:
            return None
        self._looked = time.monotonic()
        if self._room.used_up:
            return Paused(WaitReason.DISK)
        if self.may_be_superseded and self._storage.queue.update_waits(self._job.scene_id):
            return Succeeded(superseded=True)
        if self._storage.queue.must_pause(self._job.id, turn_may_end=self._turn_may_end):
            return Paused()
        return None
