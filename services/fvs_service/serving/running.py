"""``fvs serve`` as a child process, for as long as a ``with`` block lasts."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fvs_service.errors import UnavailableError
from fvs_service.serving.process_tree import command_of, descendants

GATEWAY = "fvs_service.serving.process gateway"
WORKER = "fvs_service.serving.process worker"
RUNNER = "fvs_service.host.runner.process"
"""Parts of the command lines of a service's processes; see ``RunningService.processes``."""

_STOP_WITHIN_S = 30.0


@dataclass(frozen=True)
class RunningService:
    """A service at ``url``, with gRPC at ``rpc_url`` unless it is off; ``pid`` is its supervisor's."""

    url: str
    rpc_url: str
    pid: int

    def processes(self, command: str) -> tuple[int, ...]:
        """The ids of the processes below the supervisor that run ``command`` (Linux: from ``/proc``)."""
        return tuple(pid for pid in descendants(self.pid) if command in command_of(pid))


@contextmanager
def running_service(
    root: Path, log: Path, environment: Mapping[str, str] | None = None, *, port: int = 0
) -> Iterator[RunningService]:
    """A service on loopback, with its data in ``root``; it is stopped at the end of the block.

    It listens on ``port``, or on a free one. Its log goes to ``log``; ``environment`` has further settings
    (``FVS_…``). Raises ``UnavailableError`` when it does not start.
    """
    command = [sys.executable, "-c", "from fvs_engine.cli import main; main()", "serve"]
    with (
        log.open("w") as to,
        subprocess.Popen(
            [*command, "--root", str(root), "--port", str(port)],
            stdout=subprocess.PIPE,
            stderr=to,
            text=True,
            env={**os.environ, **(environment or {})},
        ) as process,
    ):
        try:
            assert process.stdout is not None
            url = process.stdout.readline().strip()  # written once the service answers
            if not url:
                raise UnavailableError("The service did not start.", hint=f"See {log}.")
            yield RunningService(url, process.stdout.readline().strip(), process.pid)
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_STOP_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
