"""A runner as seen by its worker: starts the child process, calls it, and ends it."""

import contextlib
import os
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from fvs_engine import child_process
from fvs_engine.records import Record
from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError, call
from fvs_service.host.protocol.messages import (
    CancelJob,
    ForgetImages,
    Ping,
    RunnerOrder,
    RunnerStarted,
    RunnerStatus,
    YieldScene,
)
from fvs_service.settings import Settings

_MODULE = "fvs_service.host.runner.process"
_START_S = 300.0
"""The first start on a machine compiles the kernels."""
_RESPONSE_S = 2.0
_POLL_S = 0.1
_LOG_BYTES = 10_000_000
"""A larger log is put aside when the runner starts; the one before it is lost."""


class RunnerChild:
    """Starts a runner and waits for its endpoint; raises ``RunnerGoneError`` when it dies before.

    It listens at ``address``. ``spawner`` is the one thread that starts children: the kernel kills a child
    when the thread that made it ends.
    """

    def __init__(
        self,
        scene_id: str,
        settings: Settings,
        spawner: ThreadPoolExecutor,
        give_up: Callable[[], bool],
        address: str,
    ) -> None:
        folder = settings.scenes / scene_id
        folder.mkdir(parents=True, exist_ok=True)
        self.scene_id = scene_id
        self._writing = threading.Lock()
        order = RunnerOrder(scene_id=scene_id, parent=os.getpid(), address=address, settings=settings)
        self._process = spawner.submit(_spawn, folder / "runner.log", order).result()
        started = self._wait_until_started(give_up)
        self.endpoint = started.endpoint
        self.backend = started.backend
        """The rasteriser in use."""

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def resident_bytes(self) -> int:
        """The resident memory of the process (Linux: from ``/proc``); 0 where it is not known."""
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE")

    def extend(self) -> None:
        """Signal the runner that its worker has extended the lease."""
        with self._writing:
            child_process.write(self._process, ".")

    def idle_s(self) -> float | None:
        """The time since its last request or job; None when it does not respond."""
        try:
            return RunnerStatus.model_validate(self._call(Ping())).idle_s
        except RunnerGoneError:
            return None
        except RunnerError:
            return 0.0

    def forget_images(self) -> bool:
        """Have the images forgotten that it keeps in memory; returns False when a job runs, or it is gone."""
        try:
            self._call(ForgetImages())
        except (RunnerError, RunnerGoneError):
            return False
        return True

    def yield_scene(self) -> bool:
        """End the runner unless a job runs; returns whether it ended."""
        try:
            self._call(YieldScene())
        except RunnerError:
            return False
        except RunnerGoneError:
            pass
        self.kill()
        return True

    def retire(self, patience_s: float) -> None:
        """Cancel its job, which saves a checkpoint, and end it; kill it when that takes longer."""
        until = time.monotonic() + patience_s
        with contextlib.suppress(RunnerGoneError, RunnerError):
            self._call(CancelJob())
        while not self.yield_scene() and time.monotonic() < until:
            time.sleep(_POLL_S)
        self.kill()

    def kill(self) -> None:
        """Kill it at once; its files on disk are always whole."""
        self._process.kill()
        self._process.wait()
        child_process.close_pipes(self._process)

    def _call(self, request: Record) -> Any:
        return call(self.endpoint, request, _RESPONSE_S)

    def _wait_until_started(self, give_up: Callable[[], bool]) -> RunnerStarted:
        def extend_or_give_up() -> bool:
            self.extend()
            return give_up()

        try:
            line = child_process.first_line(self._process, _START_S, extend_or_give_up, _POLL_S)
            if not line:
                raise RunnerGoneError(f"The runner of scene {self.scene_id} did not start.")
            return RunnerStarted.model_validate_json(line)
        except BaseException:
            self.kill()
            raise


def _spawn(log: Path, order: RunnerOrder) -> "subprocess.Popen[str]":
    threads = order.settings.worker.threads
    environment = {} if threads is None else {"NUMBA_NUM_THREADS": str(threads)}
    if log.exists() and log.stat().st_size > _LOG_BYTES:
        log.replace(log.with_name("runner.old.log"))
    with log.open("a") as out:
        return child_process.spawn(_MODULE, order.model_dump_json(), stderr=out, environment=environment)
