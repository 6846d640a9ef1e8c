"""Start-up and memory of ``fvs-client spool watch``.

python benchmarks/spool_start.py [--runs 10]: wall and processor time until the outbox is there, and memory
after that, medians. Then the same for the import of the whole client, which the spool does without.
"""

import argparse
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_WHOLE_CLIENT = "import fvs_client.cli.app, fvs_client.exports"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    runs = parser.parse_args().runs
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    for name, measure in (("spool watch", _watch), ("the whole client, imported", _whole)):
        measure()  # compiles
        times = [measure() for _ in range(runs)]
        wall, processor, memory = (statistics.median(column) for column in zip(*times, strict=True))
        print(f"{name:<28} {wall:.2f} s, {processor:.2f} s of a processor, {memory / 1e3:.1f} MB")


def _watch() -> tuple[float, float, float]:
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "fvs_client",
            "--url",
            "http://127.0.0.1:9",
            "spool",
            "watch",
            folder,
        ]
        begun = time.monotonic()
        with subprocess.Popen([*command, "--scene", "scn_1"]) as process:
            while not Path(folder, ".fvs-spool.sqlite3").exists():
                time.sleep(0.001)
            wall = time.monotonic() - begun
            ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
            time.sleep(1.0)
            status = Path(f"/proc/{process.pid}/status").read_text().splitlines()
            process.send_signal(signal.SIGTERM)
    memory = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    return wall, sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK"), memory


def _whole() -> tuple[float, float, float]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.monotonic()
    reading = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    said = subprocess.run(
        [sys.executable, "-c", f"{_WHOLE_CLIENT}\n{reading}"], check=True, capture_output=True, text=True
    )
    wall = time.monotonic() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, float(said.stdout)


if __name__ == "__main__":
    main()
