"""A machine of the service: ``fvs serve`` in a process group of its own, which can be killed as a whole."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from fvs_service.serving.process_tree import command_of, descendants
from network import Host

LEASE_S = 6.0
FVS = [sys.executable, "-c", "from fvs_engine.cli import main; main()"]
SETTINGS = {
    "FVS_WORKER__INITIAL_ITERATIONS": "120",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "30",
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__THREADS": "1",
    "FVS_LEASE_S": f"{LEASE_S:g}",
    "FVS_RESERVE_BYTES": "0",
}


class Machine:
    """``fvs serve --role ROLE`` with a folder of its own, in a process group of its own."""

    def __init__(
        self, folder: Path, role: str, shared: dict[str, str], place: "Host | str", skew_s: int = 0
    ) -> None:
        """``place``: the host that it runs on, or an address of this one."""
        self._folder, self._role = folder, role
        self.host = place if isinstance(place, Host) else None
        self._address = place.address if isinstance(place, Host) else place
        self._environment = {**os.environ, **SETTINGS, **shared, "FVS_WORKER__ADDRESS": self._address}
        if skew_s:
            self._environment |= clock_ahead(skew_s, folder.parent)
        self.url = ""
        self.start()

    def start(self) -> None:
        """Start it; the address of a gateway is its ``url``."""
        command = [
            *FVS,
            "serve",
            "--log-json",
            "--root",
            str(self._folder),
            "--port",
            "0",
            "--role",
            self._role,
        ]
        if self.host is not None:
            command = self.host.command([*command, "--host", self._address])
        with self._folder.with_suffix(".log").open("a") as log:
            self.process = subprocess.Popen(
                command,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                env=self._environment,
                start_new_session=True,
            )
        assert self.process.stdout is not None
        if self._role == "gateway":
            self.url = self.process.stdout.readline().strip()
            if not self.url:
                self.kill()
                raise SystemExit(f"A gateway did not start: see {self._folder}.log")

    def processes(self, part: str) -> list[int]:
        """The ids of its processes whose command line has ``part``."""
        below = (self.process.pid, *descendants(self.process.pid))
        return [pid for pid in below if part in command_of(pid)]

    @property
    def name(self) -> str:
        """The id of its worker."""
        return (self._folder / "machine").read_text().strip() + "-0"

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to all its processes, as a failure of the machine."""
        for pid in self.processes(""):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)

    def kill(self) -> None:
        """Kill all its processes."""
        self.signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> None:
        """Stop it."""
        self.process.terminate()
        self.process.wait()


def clock_ahead(seconds: int, folder: Path) -> dict[str, str]:
    """The environment of a process whose time of day is ahead; ``folder`` gets the library for it."""
    library = folder / "clock_ahead.so"
    if not library.exists():
        source = Path(__file__).with_name("clock_ahead.c")
        compile_it = ["cc", "-shared", "-fPIC", "-O2", "-o", str(library), str(source), "-ldl"]
        try:
            subprocess.run(compile_it, check=True)
        except FileNotFoundError as error:
            raise SystemExit("--skew needs a C compiler: apt-get install gcc libc6-dev") from error
    return {"LD_PRELOAD": str(library), "CLOCK_AHEAD_S": str(seconds)}
