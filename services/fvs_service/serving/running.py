"""``fvs serve`` as a child process, for as long as a ``with`` block lasts."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fvs_service.errors import UnavailableError

GATEWAY = "fvs_service.serving.process gateway"
WORKER = "fvs_service.serving.process worker"
RUNNER = "fvs_service.worker.runner.process"
"""Parts of the command lines of a service's processes; see ``RunningService.processes``."""

_STOP_WITHIN_S = 30.0


@dataclass(frozen=True)
class RunningService:
    """A service at ``url``; ``pid`` is its supervisor's."""

    url: str
    pid: int

    def processes(self, command: str) -> tuple[int, ...]:
        """The ids of the processes below the supervisor that run ``command`` (Linux: from ``/proc``)."""
        parents = dict(_parents())
        return tuple(pid for pid in parents if self._is_above(pid, parents) and command in _command(pid))

    def _is_above(self, pid: int, parents: Mapping[int, int]) -> bool:
        while pid != self.pid and pid in parents:
            pid = parents[pid]
        return pid == self.pid


@contextmanager
def running_service(
    root: Path, log: Path, environment: Mapping[str, str] | None = None
) -> Iterator[RunningService]:
    """A service on a free port of loopback, with its data in ``root``; it is stopped at the end of the block.

    Its log goes to ``log``; ``environment`` has further settings (``FVS_…``). Raises ``UnavailableError``
    when it does not start.
    """
    command = [sys.executable, "-c", "from fvs_engine.cli import main; main()", "serve"]
    with (
        log.open("w") as to,
        subprocess.Popen(
            [*command, "--root", str(root), "--port", "0"],
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
            yield RunningService(url, process.pid)
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_STOP_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _parents() -> Iterator[tuple[int, int]]:
    """Every process's id and its parent's."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):  # the process has ended
                yield int(folder.name), int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().replace("\0", " ")
    return ""
