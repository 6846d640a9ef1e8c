"""The port through which a worker has turns run and runners started, and its implementation on one machine.

The other one is ``host.cluster``: there every scene has its host on a node of a Ray cluster, which is a
``LocalHosts``.
"""

from typing import Protocol

from fvs_engine.records import Record
from fvs_schema.jobs import WaitReason
from fvs_service.application import Storage
from fvs_service.host.worker.leased_scenes import LeasedScenes
from fvs_service.host.worker.resources import Room
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.host.worker.turns import Turns
from fvs_service.jobs.states import Turn

_STARTS_AT_ONCE = 4


class HostsStatus(Record):
    """What a worker reports of its scenes with each heartbeat.

    ``slots``: jobs that run at once (0: none can now, because the cluster is away); ``disk_full``: none
    starts for lack of room; ``runner_bytes``: the resident memory of all runners.
    """

    slots: int
    disk_full: bool
    backend: str
    runner_bytes: int

    @property
    def takes_jobs(self) -> bool:
        """Whether a turn may begin."""
        return self.slots > 0 and not self.disk_full


class SceneHosts(Protocol):
    """Runs turns of jobs and starts runners; safe to use from any thread."""

    turns_at_once: int
    """Maximum number of turns that are run at once."""
    starts_at_once: int
    """Maximum number of calls of ``start_runner`` at once."""

    def run(self, turn: Turn) -> WaitReason | None:
        """Run a turn until it or the attempt ends; returns the resource that the job lacks, if any.

        The same turn may be run again after a crash of the worker.
        """

    def start_runner(self, scene_id: str) -> None:
        """Start the scene's runner, so that it can rank; a failure is only logged."""

    @property
    def status(self) -> HostsStatus:
        """The status for the next heartbeat."""

    def stop(self) -> None:
        """End what must not outlive the worker."""


class LocalHosts:
    """The ``SceneHosts`` of one machine: runners are child processes, which listen on ``address``.

    ``trains``: updates go on with training when their images are registered; else they are left to a host
    that trains.
    """

    def __init__(
        self, storage: Storage, worker_id: str, address: str = "127.0.0.1", *, trains: bool = True
    ) -> None:
        settings = storage.settings
        self.turns_at_once, self.starts_at_once = settings.worker.jobs_at_once, _STARTS_AT_ONCE
        self._room = Room(settings)
        self._scenes = LeasedScenes(storage, worker_id, address)
        self._turns = Turns(storage, self._scenes, worker_id, self._room, trains=trains)
        self.run = self._turns.run
        self.start_runner = self._scenes.start_runner
        self.idle_s = self._scenes.idle_s
        self.folder = settings.root
        self._sweeps = Sweeps(storage, self._scenes.without_jobs)
        self._sweeps.start()

    @property
    def status(self) -> HostsStatus:
        """See ``SceneHosts``."""
        return HostsStatus(
            slots=self.turns_at_once,
            disk_full=self._room.short,
            backend=self._scenes.backend,
            runner_bytes=self._scenes.resident_bytes,
        )

    def stop(self) -> None:
        """See ``SceneHosts``."""
        self._sweeps.stop()
        self._scenes.stop()
