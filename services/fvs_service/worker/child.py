"""A runner as its worker sees it: a child process, the way to it, and the end of it."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fvs_service.settings import Settings
from fvs_service.worker.protocol import (
    CancelQuestion,
    PingQuestion,
    RunnerError,
    RunnerGoneError,
    YieldQuestion,
    answer_to,
    connect,
)
from fvs_service.worker.runner.process import RunnerOrder

_COMMAND = [sys.executable, "-m", "fvs_service.worker.runner.process"]
_START_S = 300.0
"""The first start on a machine compiles the kernels."""
_SHORT_S = 2.0
_POLL_S = 0.1


class RunnerChild:
    """Starts a runner and waits for its endpoint; raises ``RunnerGoneError`` when it dies before.

    ``spawner`` is the thread that makes children: where a parent's death kills its children, it is the death
    of the thread that made them.
    """

    def __init__(
        self, scene_id: str, settings: Settings, spawner: ThreadPoolExecutor, give_up: Callable[[], bool]
    ) -> None:
        folder = settings.scenes / scene_id
        folder.mkdir(parents=True, exist_ok=True)
        self.scene_id = scene_id
        self._process = spawner.submit(_spawn, folder / "runner.log", settings).result()
        self._extending = threading.Lock()
        order = RunnerOrder(scene_id=scene_id, parent=os.getpid(), settings=settings)
        self._write(order.model_dump_json().encode() + b"\n")
        self.endpoint = self._await_endpoint(give_up)

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def extend(self) -> None:
        """Tell the runner that its worker still holds the lease."""
        self._write(b".")

    def idle_s(self) -> float:
        """For how long nobody has asked it for anything; 0 when it does not say."""
        try:
            answer = self._ask(PingQuestion())
        except (RunnerGoneError, RunnerError):
            return 0.0
        return float(answer["idle_s"])

    def yield_scene(self) -> bool:
        """Ask it to end unless it is working; whether it did."""
        try:
            self._ask(YieldQuestion())
        except RunnerError:
            return False
        except RunnerGoneError:
            pass
        self.kill()
        return True

    def retire(self, patience_s: float) -> None:
        """Have it save what it is learning, and end it; at once when that takes too long."""
        until = time.monotonic() + patience_s
        with contextlib.suppress(RunnerGoneError, RunnerError):
            self._ask(CancelQuestion())
        while not self.yield_scene() and time.monotonic() < until:
            time.sleep(_POLL_S)
        self.kill()

    def kill(self) -> None:
        """End it at once; what is on its disk is whole."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _ask(self, question: PingQuestion | YieldQuestion | CancelQuestion) -> dict[str, float]:
        line = connect(self.endpoint, _SHORT_S)
        try:
            line.wait_at_most(_SHORT_S)
            answer: dict[str, float] = answer_to(line, question)
            return answer
        finally:
            line.close()

    def _write(self, content: bytes) -> None:
        assert self._process.stdin is not None
        with self._extending, contextlib.suppress(OSError, ValueError):  # its death is seen elsewhere
            self._process.stdin.write(content)
            self._process.stdin.flush()

    def _await_endpoint(self, give_up: Callable[[], bool]) -> str:
        said: list[bytes] = []
        stdout = self._process.stdout
        assert stdout is not None
        reader = threading.Thread(target=lambda: said.append(stdout.readline()), daemon=True)
        reader.start()
        waited = 0.0
        while reader.is_alive() and waited < _START_S and not give_up():
            self.extend()
            reader.join(_POLL_S)
            waited += _POLL_S
        if not said or not said[0]:
            self.kill()
            raise RunnerGoneError(f"The runner of scene {self.scene_id} did not start.")
        endpoint: str = json.loads(said[0])["endpoint"]
        return endpoint


def _spawn(log: Path, settings: Settings) -> "subprocess.Popen[bytes]":
    environment = dict(os.environ)
    if settings.worker.threads is not None:
        environment |= {"NUMBA_NUM_THREADS": str(settings.worker.threads)}
    with log.open("ab") as out:
        return subprocess.Popen(
            _COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=out,
            env=environment,
            start_new_session=True,  # Ctrl-C in a terminal is for the supervisor alone
        )
