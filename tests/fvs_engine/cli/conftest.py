import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fvs_engine.cli.app import app


@dataclass(frozen=True)
class Run:
    """How one call of the program ended."""

    status: int
    stdout: str
    stderr: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON document on stdout."""
        (line,) = self.stdout.splitlines()
        return json.loads(line)


@pytest.fixture(scope="session")
def fvs() -> Callable[..., Run]:
    """Call the program in this process: the libraries are imported once for all tests."""

    def call(*arguments: object) -> Run:
        result = CliRunner().invoke(app, [str(argument) for argument in arguments])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return Run(result.exit_code, result.stdout, result.stderr)

    return call


@pytest.fixture(scope="session")
def fvs_command() -> Callable[..., list[str]]:
    """The command line of the installed program, for tests that need a process of its own."""
    program = str(Path(sys.executable).with_name("fvs"))
    return lambda *arguments: [program, *map(str, arguments)]


@pytest.fixture(scope="session")
def fvs_until(fvs_command: Callable[..., list[str]]) -> Callable[..., tuple[int, str]]:
    """Run the program with --json until it writes a report that ``wanted`` accepts, then send a signal.

    Returns the exit status and the rest of what the program said on stderr.
    """

    def call(*arguments: object, wanted: Callable[[dict[str, Any]], bool], number: int) -> tuple[int, str]:
        command = fvs_command(*arguments, "--json")
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stderr=pipe, stdout=pipe, text=True) as process:
            assert process.stderr is not None
            for line in process.stderr:
                if wanted(json.loads(line)):
                    process.send_signal(number)
                    break
            _, rest = process.communicate(timeout=120)
        return process.returncode, rest

    return call
