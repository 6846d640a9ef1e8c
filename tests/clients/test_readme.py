"""The examples of the client's README work as they are written."""

import re
import shlex
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from fvs_client.cli import exit_codes
from fvs_client.cli.app import app

README = Path(__file__).resolve().parent.parent.parent / "clients" / "python" / "README.md"


def _blocks(language: str) -> list[str]:
    fenced = re.findall(
        r"^```(\w*)\n(.*?)^```$", README.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    return [block for name, block in fenced if name == language]


def test_the_examples_run(
    serve: Callable[..., Any], photographs: Path, monkeypatch: pytest.MonkeyPatch, photograph: Any
) -> None:
    gateway = serve()
    monkeypatch.setenv("FVS_URL", str(gateway.client.base_url))
    monkeypatch.chdir(photographs.parent)
    (photographs / "0001.jpg").write_bytes(photograph(11))
    examples = _blocks("python")
    assert len(examples) == 4
    ended = threading.Event()

    def work() -> None:
        while not ended.is_set():
            waiting = [ticket.scene_id for ticket in gateway.engine.submitted.values()]
            if waiting:
                gateway.model(waiting[0])
                return
            time.sleep(0.02)

    worker = threading.Thread(target=work)
    worker.start()
    try:
        for example in examples:
            code = example.replace('Client("http://127.0.0.1:8000")', "Client()")
            code = code.replace("count=24", "count=5")  # the tests' rasteriser is the slow one
            exec(compile(code, str(README), "exec"), {"__name__": "readme"})
    finally:
        ended.set()
        worker.join()
    assert (photographs.parent / "model" / "point_cloud.ply").is_file()
    assert (photographs.parent / "next-view.png").read_bytes().startswith(b"\x89PNG")


def test_the_commands_exist() -> None:
    group = typer.main.get_command(app)
    commands = [block for block in _blocks("") if block.startswith("fvs-client")]
    assert len(commands) == 1
    for line in commands[0].splitlines():
        words = shlex.split(re.split(r"\s{3,}", line)[0])[1:]
        with group.make_context("fvs-client", words[:1]) as context:
            name, command, _ = group.resolve_command(context, words)  # type: ignore[attr-defined]
        assert command is not None, name
        options = {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        }
        assert {word for word in words if word.startswith("--")} <= options, line


def test_the_statuses_are_those_of_the_program() -> None:
    told = {
        int(status)
        for status in re.findall(r"^\| (\d+) \|", README.read_text(encoding="utf-8"), re.MULTILINE)
    }
    used = {status for _, status in exit_codes._STATUSES}
    assert told == used | {0, exit_codes.BUG, exit_codes.USAGE, exit_codes.SOME_FILES, exit_codes.INTERRUPTED}
