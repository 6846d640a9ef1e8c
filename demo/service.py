"""The service for a while: started on a free port of loopback, stopped at the end, whatever happens."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FVS = Path(sys.executable).with_name("fvs")
_STOP_WITHIN_S = 20.0


@contextmanager
def running_service(root: Path, log: Path) -> Iterator[str]:
    """The URL of a service that keeps everything in ``root``; its log goes to ``log``."""
    command = [str(FVS), "serve", "--root", str(root), "--port", "0"]
    with (
        log.open("w") as to,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=to, text=True) as process,
    ):
        try:
            assert process.stdout is not None
            url = process.stdout.readline().strip()  # it is said once the service answers
            if not url:
                raise SystemExit(f"The service did not start; {log} says why.")
            yield url
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_STOP_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
