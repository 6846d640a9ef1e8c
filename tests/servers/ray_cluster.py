"""A throw-away Ray cluster: its head and nodes are machines, each with a network and a folder of its own."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from fvs_service.serving.process_tree import command_of
from network import Host, Network

DETECTION_S = 6.0
"""After this time the head declares a node dead that does not answer: 3 times its period and timeout."""
_START_S = 120.0
_STARTED = "Ray runtime started"
_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "disabled",  # else a head asks for a token where ~/.ray/auth_token exists
    "GRPC_ENABLE_FORK_SUPPORT": "0",
    "RAY_health_check_initial_delay_ms": "1000",
    "RAY_health_check_period_ms": "1000",
    "RAY_health_check_timeout_ms": "1000",
    "RAY_health_check_failure_threshold": "3",
    # The processor is that of all machines, so no process is started before it is needed.
    "RAY_prestart_worker_first_driver": "0",
    "RAY_enable_worker_prestart": "0",
    "RAY_gcs_storage": "rocksdb",
}
_GCS_PORT, _CLIENT_PORT = 6379, 10001
_OBJECT_STORE_BYTES = 80_000_000
_OWN_PROCESSES = ("unshare", "--pid", "--fork", "--kill-child", "--mount-proc")
"""What ends all processes with the first; Ray finds no processes of other machines."""


class RayMachine:
    """A machine that ``ray start`` makes a part of a cluster; all its processes can fail together.

    Processes that the machine starts have ``folder`` as ``FVS_ROOT``; what they print is in ``log``.
    """

    def __init__(self, host: Host, folder: Path, sessions: Path, options: tuple[str, ...]) -> None:
        self.host, self.folder = host, folder
        self.log = folder.with_suffix(".log")
        self._command = [
            *(sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--disable-usage-stats"),
            *(f"--node-ip-address={host.address}", f"--temp-dir={sessions}"),
            *(f"--object-store-memory={_OBJECT_STORE_BYTES}", *options),
        ]

    def start(self) -> None:
        """Start it, without waiting for it."""
        environment = {**os.environ, **_SETTINGS, "FVS_ROOT": str(self.folder)}
        environment["RAY_gcs_storage_path"] = str(self.folder / "gcs")  # from which a head starts again
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # each actor would compile all that it imports
        self._since = self.log.stat().st_size if self.log.exists() else 0
        with self.log.open("a") as log:
            self._process = subprocess.Popen(
                self.host.command([*_OWN_PROCESSES, *self._command]), stdout=log, stderr=log, env=environment
            )

    def wait(self) -> None:
        """Wait until it is a part of the cluster."""
        until = time.monotonic() + _START_S
        while not self.is_up:
            if not self.runs or time.monotonic() > until:
                raise RuntimeError(f"Ray does not start: {self.log.read_text()[-2000:]}")
            time.sleep(0.05)

    @property
    def is_up(self) -> bool:
        """Whether it runs, and has become a part of the cluster since its last start."""
        return self.runs and _STARTED in self.log.read_text()[self._since :]

    def processes(self, part: str) -> list[int]:
        """The ids of its processes whose command line has ``part``."""
        return [pid for pid in self.host.processes() if part in command_of(pid)]

    @property
    def runs(self) -> bool:
        """Whether ``ray start`` runs, which ends with its raylet."""
        return self._process.poll() is None

    def kill(self) -> None:
        """Kill all its processes, as a loss of power does."""
        while self._send(signal.SIGKILL):
            time.sleep(0.02)
        self._process.wait()

    def freeze(self) -> None:
        """Stop all its processes, until ``thaw``."""
        self._send(signal.SIGSTOP)

    def thaw(self) -> None:
        """Continue all its processes."""
        self._send(signal.SIGCONT)

    def _send(self, number: signal.Signals) -> bool:
        found = self.host.processes()
        for pid in found:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
        return bool(found)


class RayCluster:
    """A head without CPUs, and nodes, each in a network namespace; ends with its block. Needs root.

    This process has the address ``network.address``, and reaches the cluster at ``url``.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stack = ExitStack()
        self.nodes: list[RayMachine] = []

    def __enter__(self) -> "RayCluster":
        with self._stack as stack:
            self.network = stack.enter_context(Network())
            # Not below ``folder``: the paths of Ray's sockets must be short.
            self._sessions = Path(stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True)))
            options = ("--head", f"--port={_GCS_PORT}", f"--ray-client-server-port={_CLIENT_PORT}")
            self.head = self._machine("head", *options, "--num-cpus=0", "--include-dashboard=false")
            self.head.wait()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def url(self) -> str:
        """The address for clients, as ``FVS_CLUSTER`` has it."""
        return f"ray://{self.head.host.address}:{_CLIENT_PORT}"

    def add_node(self, cpus: int = 2, gpus: int = 0, memory_bytes: int = 4 << 30) -> RayMachine:
        """A new node, which is starting; its GPUs exist only for Ray."""
        address = f"--address={self.head.host.address}:{_GCS_PORT}"
        resources = (f"--num-cpus={cpus}", f"--num-gpus={gpus}", f"--memory={memory_bytes}")
        node = self._machine(f"node-{len(self.nodes) + 1}", address, *resources)
        self.nodes.append(node)
        return node

    def _machine(self, name: str, *options: str) -> RayMachine:
        machine = RayMachine(self.network.host(), self._folder / name, self._sessions / name, options)
        self._stack.callback(machine.kill)
        machine.folder.mkdir(parents=True)
        machine.start()
        return machine
