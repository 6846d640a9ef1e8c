"""MAVSDK, before version 4 and since, and MAVProxy with the simulated vehicle.

Nobody here wrote these programs. They are installed into environments of their own, and run as programs.
"""

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from simulators import Simulator

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.timeout(900)]

CALLS = Path(__file__).parent / "programs" / "mavsdk_calls.py"
MISSION = """QGC WPL 110
0 1 0 16 0 0 0 0 47.3769 8.5417 440 1
1 0 3 22 0 0 0 0 47.3769 8.5417 10 1
2 0 3 16 0 0 0 0 47.3772 8.5417 12 1
3 0 3 203 0 0 0 0 1 0 0 1
4 0 3 16 0 0 0 0 47.3772 8.5420 12 1
5 0 3 20 0 0 0 0 0 0 0 1
""".replace(" ", "\t").replace("QGC\tWPL\t", "QGC WPL ")
FENCE = """47.3769 8.5417
47.3759 8.5407
47.3779 8.5407
47.3779 8.5427
47.3759 8.5427
47.3759 8.5407
"""
SAID = [
    ("", "online system 1"),
    ("", r"Received \d+ parameters"),
    ("param show WPNAV_SPEED", r"WPNAV_SPEED +500"),
    ("param set WPNAV_SPEED 600", "GUIDED|STABILIZE"),
    ("param fetch WPNAV_SPEED", r"WPNAV_SPEED *= *600"),
    ("wp load way.txt", "Loaded 6 waypoints"),
    ("wp save back.txt", "Saved 6 waypoints to back.txt"),
    ("fence load fence.txt", "Loaded|Sent|Saved"),
    ("fence list", "Saved 5 fence items"),
    ("fence enable", "DO_FENCE_ENABLE: ACCEPTED"),
    ("fence disable", "DO_FENCE_ENABLE: ACCEPTED"),
    ("mode GUIDED", "Mode GUIDED"),
    ("arm throttle", r"(?s)COMPONENT_ARM_DISARM: ACCEPTED.*ARMED"),
    ("takeoff 8", "NAV_TAKEOFF: ACCEPTED"),
    ("mode AUTO", "Mode AUTO"),
    ("", "Reached command #2"),
    ("mode LOITER", "Mode LOITER"),
    ("wp set 4", "DO_SET_MISSION_CURRENT: ACCEPTED"),
    ("mode AUTO", "Mode AUTO"),
    ("rtl", "Mode RTL"),
    ("", "DISARMED"),
    ("wp clear", "MISSION_ACK: TYPE_MISSION: ACCEPTED"),
]
"""What is typed into MAVProxy, and what it says then."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of an environment's programs, with a package in it."""
    made: dict[str, Path] = {}

    def install(package: str) -> Path:
        if package not in made:
            folder = tmp_path_factory.mktemp("programs")
            subprocess.run([sys.executable, "-m", "venv", folder], check=True)
            made[package] = folder / "bin"
            pip = [made[package] / "python", "-m", "pip", "install", "--quiet", package]
            subprocess.run(pip, check=True)
        return made[package]

    return install


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
@pytest.mark.parametrize("package", ["mavsdk==3.17.4", "mavsdk==4.1.0"])
def test_calls_of_mavsdk_work(
    tmp_path: Path, installed: Callable[[str], Path], package: str, firmware: Any
) -> None:
    python = installed(package) / "python"
    with closing(Simulator(tmp_path, 0, firmware, speed_up=8.0)) as simulator:
        url = simulator.url.replace("tcp:", "tcpout://")
        done = subprocess.run(
            [python, CALLS, url, firmware], stdout=subprocess.PIPE, text=True, timeout=600, check=True
        )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line for line in lines if "error" in line] == []
    assert len(lines) >= 65
    photographs = {path.name for path in tmp_path.glob("*.jpg")}
    assert photographs == {"00000.jpg", "00001.jpg"}  # one that was asked for, one of the mission


def test_mavproxy_flies_a_mission(tmp_path: Path, installed: Callable[[str], Path]) -> None:
    (tmp_path / "way.txt").write_text(MISSION)
    (tmp_path / "fence.txt").write_text(FENCE)
    programs = installed("MAVProxy==1.8.75")
    with closing(Simulator(tmp_path, 0, speed_up=8.0)) as simulator:
        command = [programs / "python", programs / "mavproxy.py", f"--master={simulator.url}", "--nowait"]
        places = [f"--aircraft={tmp_path / 'aircraft'}", f"--state-basedir={tmp_path}"]
        with subprocess.Popen(
            [*command, *places],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=tmp_path,
        ) as program:
            terminal = Terminal(program)
            try:
                for typed, said in SAID:
                    terminal.type(typed, said)
            finally:
                program.kill()
    assert (tmp_path / "back.txt").read_text().count("\n") == 7
    assert len(list(tmp_path.glob("*.jpg"))) == 1


class Terminal:
    """The terminal of a program."""

    def __init__(self, program: "subprocess.Popen[bytes]") -> None:
        self._program, self._text = program, ""
        threading.Thread(target=self._read, daemon=True).start()
        self._seen = 0

    def type(self, line: str, said: str) -> None:
        """Type a line, if there is one, and wait for what is said since the last one."""
        assert self._program.stdin is not None
        if line:
            self._seen = len(self._text)
            self._program.stdin.write(f"{line}\n".encode())
            self._program.stdin.flush()
        until = time.monotonic() + 90.0
        while re.search(said, self._text[self._seen :]) is None:
            assert time.monotonic() < until, f"{line!r}: no {said!r} in {self._text[self._seen :]!r}"
            time.sleep(0.05)

    def _read(self) -> None:
        assert self._program.stdout is not None
        while data := os.read(self._program.stdout.fileno(), 4096):
            self._text += data.decode(errors="replace")
