import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import httpx2
import pytest
from fvs_service.serving import pulse
from fvs_service.serving.pulse import Pulse

_SERVICE = """
import sys
from pathlib import Path
from fvs_service.serving import supervisor
from fvs_service.serving.stop_signals import StopSignals
from fvs_service.settings import Settings

supervisor._SILENT_S, supervisor._LOOK_S = {"gateway": 8.0, "worker": 8.0}, 0.5
settings = Settings(root=Path(sys.argv[1]), port=0, grpc=False)
role = supervisor.Role(sys.argv[2])
with StopSignals(8, lambda: None) as signals:
    service = supervisor.Supervisor(settings, signals, log_json=False, role=role)
    service.run(lambda line: print(line, flush=True))
"""


class Clock:
    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(pulse, "time", clock)
    return clock


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


def test_silence_is_counted_from_the_last_beat(clock: Clock, pipe: tuple[int, int]) -> None:
    read, write = pipe
    watched = Pulse(read)
    clock.now = 100.0
    assert watched.silent_s() == 0  # it is still starting
    os.write(write, b"\n\n")
    assert watched.silent_s() == 0
    clock.now = 105.0
    assert watched.silent_s() == 5.0
    clock.now = 108.0
    assert watched.silent_s() == 8.0
    os.write(write, b"\n")
    assert watched.silent_s() == 0


def test_the_sleep_of_the_supervisor_is_no_silence_of_the_gateway(
    clock: Clock, pipe: tuple[int, int]
) -> None:
    read, write = pipe
    watched = Pulse(read)
    os.write(write, b"\n")
    watched.silent_s()
    clock.now = 3600.0
    assert watched.silent_s() < 60


def _children(supervisor: int, role: bytes) -> list[int]:
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    return [int(pid) for pid in children if role in Path(f"/proc/{pid}/cmdline").read_bytes()]


def _gateway_of(supervisor: int) -> int:
    (gateway,) = _children(supervisor, b"gateway")
    return gateway


@pytest.mark.system
@pytest.mark.process
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for the gateway in /proc")
def test_a_gateway_that_hangs_is_restarted(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _SERVICE, str(tmp_path), "gateway"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        url = next(line.strip() for line in process.stdout if line.startswith("http"))
        try:
            hangs = _gateway_of(process.pid)
            os.kill(hangs, signal.SIGSTOP)
            with pytest.raises(httpx2.TimeoutException):
                httpx2.get(f"{url}/livez", timeout=0.5)
            answered = None
            while answered is None:
                try:
                    answered = httpx2.get(f"{url}/livez", timeout=1).status_code
                except httpx2.TransportError:
                    time.sleep(0.2)
            assert answered == 200
            assert _gateway_of(process.pid) != hangs
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(20) in (0, -signal.SIGTERM)


@pytest.mark.system
@pytest.mark.process
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for the worker in /proc")
def test_a_worker_that_hangs_is_restarted(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _SERVICE, str(tmp_path), "all"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            _read_until(process.stderr, "worker ready")
            (hangs,) = _children(process.pid, b"worker")
            os.kill(hangs, signal.SIGSTOP)
            _read_until(process.stderr, "worker ready")
            assert hangs not in _children(process.pid, b"worker")
        finally:
            process.send_signal(signal.SIGTERM)
        process.stderr.read()
        assert process.wait(20) in (0, -signal.SIGTERM)


def _read_until(lines: Iterable[str], sign: str) -> None:
    assert any(sign in line for line in lines), sign
