import configparser
import json
import os
import shlex
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Client
from fvs_client.cli import command_of
from fvs_client.cli.app import app
from fvs_client.spool.lock import has_sender
from fvs_client.spool.outbox import FILE_NAME
from typer.testing import CliRunner


@pytest.fixture
def folder(tmp_path: Path, photograph: Callable[..., bytes]) -> Path:
    made = tmp_path / "my photographs"
    made.mkdir()
    for number in range(2):
        (made / f"DJI_{number:04d}.JPG").write_bytes(photograph(number))
    return made


def _run(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_command_is_found_among_the_options() -> None:
    assert command_of(["spool", "watch"]) == "spool"
    assert command_of(["--url", "http://spool", "--api-key=k", "upload"]) == "upload"
    assert command_of(["--url=x", "--api-key", "k", "spool"]) == "spool"
    assert command_of(["--help"]) is None
    assert command_of(["--json", "rank", "spool"]) is None
    assert command_of([]) is None


def test_photographs_are_added_shown_sent_and_shown(folder: Path, url: str, client: Client) -> None:
    scene = client.scenes.create("quarry").id
    (folder / "torn.jpg").write_bytes((folder / "DJI_0000.JPG").read_bytes()[:-1])
    (folder / "bad.jpg").write_bytes((folder / "DJI_0000.JPG").read_bytes() + b"x")
    (folder / "bad.json").write_text('{"heading": 1}')
    result = _run("spool", "add", *sorted(folder.glob("*.[jJ][pP][gG]")), "--scene", scene)
    assert result.exit_code == 10, result.output
    assert "DJI_0000.JPG: waiting" in result.output
    assert "torn.jpg has no end" in result.output
    assert "bad.json cannot be used. heading: there is no such field" in result.output

    document = json.loads(_run("spool", "status", folder, "--json").stdout)
    assert document["counts"] == {"arriving": 1, "waiting": 2, "sending": 0, "sent": 0, "refused": 1}
    assert document["arriving"] == ["torn.jpg"]
    assert {found["name"]: found["state"] for found in document["photographs"]} == {
        "DJI_0000.JPG": "waiting",
        "DJI_0001.JPG": "waiting",
        "bad.jpg": "refused",
    }
    table = _run("spool", "status", folder).stdout
    assert "2 waiting" in table
    assert "No spool is running here" in table

    sent = _run("--url", url, "spool", "send", folder, "--max-rate", "5MB")
    assert (sent.exit_code, sent.stdout) == (10, "2 sent, 1 refused, 0 left\n")
    (folder / "bad.json").unlink()
    assert _run("spool", "retry", folder).stdout == "bad.jpg: waiting\n"
    assert _run("spool", "retry", folder).stdout == ""
    sent = _run("--url", url, "spool", "send", folder)
    assert (sent.exit_code, sent.stdout) == (0, "3 sent, 0 refused, 0 left\n")
    document = json.loads(_run("spool", "status", folder, "--json").stdout)
    assert {found["verdict"] for found in document["photographs"]} == {"accepted", "duplicate"}


def test_without_a_link_everything_waits(folder: Path) -> None:
    assert _run("spool", "add", folder / "DJI_0000.JPG", "--scene", "scn_1").exit_code == 0
    sent = _run("--url", "http://127.0.0.1:9", "spool", "send", folder, "--timeout", 0.5)
    assert (sent.exit_code, sent.stdout) == (4, "0 sent, 0 refused, 1 left\n")
    assert "No connection to http://127.0.0.1:9" in sent.stderr
    document = json.loads(_run("spool", "status", folder, "--json").stdout)
    assert "No connection" in document["trouble"]["message"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["watch", "{folder}", "--scene", "north quarry"], "not a scene id"),
        (["watch", "{folder}/nowhere", "--scene", "scn_1"], "does not exist"),
        (["send", "{folder}"], "There is no outbox"),
        (["status", "{folder}"], "There is no outbox"),
        (["watch", "{folder}", "--scene", "scn_1", "--max-rate", "fast"], "is not a size"),
        (
            ["--url", "grpc://host:1", "watch", "{folder}", "--scene", "scn_1"],
            "not a URL that the spool can use",
        ),
    ],
)
def test_wrong_usage_is_explained(folder: Path, arguments: Sequence[str], message: str) -> None:
    words = [word.format(folder=folder) for word in arguments]
    program = words[:2] if words[0] == "--url" else []
    result = _run(*program, "spool", *words[len(program) :])
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.output.replace("│", " ").split())


def test_the_unit_runs_what_was_asked_for(folder: Path) -> None:
    options = ["--newest-first", "--max-rate", "100kB", "--delete-sent", "--max-disk", "8GB"]
    result = _run("spool", "unit", folder, "--scene", "scn_1", *options)
    assert result.exit_code == 0, result.output
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(result.stdout)
    command = shlex.split(unit["Service"]["ExecStart"])
    assert command[1:] == [
        *("spool", "watch", str(folder), "--scene", "scn_1", "--newest-first", "--max-rate", "100000"),
        *("--delete-sent", "--max-disk", "8000000000"),
    ]
    assert shlex.split(unit["Service"]["ReadWritePaths"]) == [str(folder)]
    assert unit["Service"]["Restart"] == "always"


def test_the_unit_survives_odd_names(tmp_path: Path) -> None:
    folder = tmp_path / 'a "100%" $card'
    folder.mkdir()
    text = _run("spool", "unit", folder, "--scene", "scn_1").stdout
    start = next(line for line in text.splitlines() if line.startswith("ExecStart="))
    assert 'a \\"100%%\\" $$card"' in start
    paths = next(line for line in text.splitlines() if line.startswith("ReadWritePaths="))
    assert 'a \\"100%%\\" $card"' in paths


def _command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "fvs_client", *map(str, arguments)]


@pytest.mark.system
@pytest.mark.process
def test_a_watch_that_is_killed_goes_on_and_one_that_is_ended_exits_with_0(
    folder: Path, url: str, client: Client
) -> None:
    scene = client.scenes.create("quarry").id
    command = _command("--url", url, "spool", "watch", folder, "--scene", scene)
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as killed:
        _wait_for(lambda: has_sender(folder / FILE_NAME))
        killed.kill()
    assert not has_sender(folder / FILE_NAME)
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as running:
        _wait_for(lambda: _sent(folder) == 2)
        running.send_signal(signal.SIGTERM)
        assert running.wait(10) == 0
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as interrupted:
        _wait_for(lambda: has_sender(folder / FILE_NAME))
        interrupted.send_signal(signal.SIGINT)
        assert interrupted.wait(10) == 130
    assert len(list(client.scenes.images(scene).list())) == 2


@pytest.mark.process
def test_the_spool_imports_no_more_than_it_needs(folder: Path) -> None:
    """60 MB and 1 s are the limits; a machine of tests is no place to measure seconds."""
    environment = {**os.environ, "PYTHONPROFILEIMPORTTIME": "1"}
    command = _command("--url", "http://127.0.0.1:9", "spool", "watch", folder, "--scene", "scn_1")
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as running:
        _wait_for(lambda: _known(folder) == 2)
        status = Path(f"/proc/{running.pid}/status").read_text()
        running.terminate()
        _, said = running.communicate(timeout=10)
    imported = {
        line.rpartition("|")[2].strip() for line in said.splitlines() if line.startswith("import time")
    }
    assert "fvs_client.spool.spool" in imported
    assert not imported & {"httpx2", "anyio", "rich", "numpy", "asyncio", "fvs_client.exports"}
    highest_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM"))
    assert highest_kb < 60_000


def _sent(folder: Path) -> int:
    return _count(folder, "state = 'sent'")


def _known(folder: Path) -> int:
    return _count(folder, "1")


def _count(folder: Path, condition: str) -> int:
    try:
        database = sqlite3.connect(f"file:{folder / FILE_NAME}?mode=ro", uri=True)
        (count,) = database.execute(f"SELECT count(*) FROM photographs WHERE {condition}").fetchone()
        database.close()
    except sqlite3.OperationalError:  # not made yet
        return 0
    return int(count)


def _wait_for(condition: Callable[[], Any]) -> None:
    for _ in range(600):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError
