"""Start-up and memory of ``fvs-client spool watch``.

python benchmarks/spool_start.py [--runs 10]: wall and processor time until the outbox is there, and memory
after that, medians. Then the same for the import of the whole client, which the spool does without.

python benchmarks/spool_start.py --photographs 12000: memory and processor time with so many photographs in
the folder while they are taken and sent through a link, that of ``tests/servers/link_simulator.py``.
"""

import argparse
import io
import os
import resource
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import httpx2
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))

from link_simulator import LinkQuality, LinkSimulator

_WHOLE_CLIENT = "import fvs_client.cli.app, fvs_client.exports"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--photographs", type=int, default=0)
    parser.add_argument("--port", type=int, default=8942)
    options = parser.parse_args()
    runs = options.runs
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if options.photographs:
        with tempfile.TemporaryDirectory() as folder:
            _with_photographs(options.photographs, options.port, Path(folder))
        return
    for name, measure in (("spool watch", _watch), ("the whole client, imported", _whole)):
        measure()  # compiles
        times = [measure() for _ in range(runs)]
        wall, processor, memory = (statistics.median(column) for column in zip(*times, strict=True))
        print(f"{name:<28} {wall:.2f} s, {processor:.2f} s of a processor, {memory / 1e3:.1f} MB")


def _with_photographs(count: int, port: int, folder: Path) -> None:
    """Serve a gateway behind a link, and watch a folder until all photographs are taken and some are sent."""
    dcim = folder / "DCIM"
    dcim.mkdir()
    for number in range(count):
        (dcim / f"DJI_{number:05d}.JPG").write_bytes(_photograph(number))
    serve = [str(Path(sys.executable).with_name("fvs")), "serve", "--root", str(folder / "service")]
    serve += ["--port", str(port), "--role", "gateway", "--no-grpc"]
    with (
        (folder / "service.log").open("w") as log,
        subprocess.Popen(serve, stderr=log, stdout=log) as service,
    ):
        try:
            scene = _scene(f"http://127.0.0.1:{port}")
            with LinkSimulator(port, LinkQuality(rate_bytes_s=1e6, latency_s=0.02)) as link:
                command = [sys.executable, "-m", "fvs_client", "--url", link.url, "spool", "watch", str(dcim)]
                with subprocess.Popen([*command, "--scene", scene], stderr=subprocess.DEVNULL) as process:
                    _observe(process.pid, dcim, count)
                    process.send_signal(signal.SIGTERM)
        finally:
            service.terminate()


def _observe(process: int, folder: Path, count: int) -> None:
    begun = time.monotonic()
    taken = sent = 0
    while taken < count or sent < _SENT:
        time.sleep(0.5)
        taken, sent = _counts(folder)
    elapsed_s, ticks = time.monotonic() - begun, _ticks(process)
    time.sleep(_OBSERVED_S)
    share = (_ticks(process) - ticks) / os.sysconf("SC_CLK_TCK") / _OBSERVED_S
    _, now = _counts(folder)
    print(f"{taken} photographs taken and {sent} sent after {elapsed_s:.0f} s")
    print(
        f"at most {_kilobytes(process) / 1e3:.1f} MB; then {share:.3f} of a processor, with {now - sent} sent"
    )


def _counts(folder: Path) -> tuple[int, int]:
    """Photographs in the outbox, and those that were sent."""
    try:
        with closing(sqlite3.connect(f"file:{folder}/.fvs-spool.sqlite3?mode=ro", uri=True)) as outbox:
            query = "SELECT count(*), total(state = 'sent') FROM photographs"
            taken, sent = outbox.execute(query).fetchone()
    except sqlite3.OperationalError:  # not made yet
        return 0, 0
    return taken, int(sent)


def _scene(url: str) -> str:
    with httpx2.Client(base_url=url, timeout=60) as client:
        for _ in range(600):
            try:
                return str(client.post("/v1/scenes", json={"name": "field"}).json()["id"])
            except httpx2.TransportError:
                time.sleep(0.1)
    raise SystemExit("The service does not start.")


def _photograph(number: int) -> bytes:
    """A small JPEG with bytes of its own."""
    comment = b"\xff\xfe\x00\x0a" + number.to_bytes(8, "big")
    return _SMALL[:2] + comment + _SMALL[2:]


def _small() -> bytes:
    out = io.BytesIO()
    Image.effect_noise((96, 64), 60.0).convert("RGB").save(out, "JPEG")
    return out.getvalue()


_SMALL = _small()
_SENT = 200
_OBSERVED_S = 20.0


def _ticks(process: int) -> int:
    return sum(map(int, Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]))


def _kilobytes(process: int) -> int:
    status = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


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
            ticks = _ticks(process.pid)
            time.sleep(1.0)
            memory = _kilobytes(process.pid)
            process.send_signal(signal.SIGTERM)
    return wall, ticks / os.sysconf("SC_CLK_TCK"), memory


def _whole() -> tuple[float, float, float]:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.monotonic()
    reading = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
    output = subprocess.run(
        [sys.executable, "-c", f"{_WHOLE_CLIENT}\n{reading}"], check=True, capture_output=True, text=True
    )
    wall = time.monotonic() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, float(output.stdout)


if __name__ == "__main__":
    main()
