import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest


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
    """Call the installed program as a user does."""
    program = Path(sys.executable).with_name("fvs")

    def call(*arguments: object, prefix: tuple[str, ...] = ()) -> Run:
        command = [*prefix, str(program), *map(str, arguments)]
        run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)
        assert "Traceback" not in run.stderr, run.stderr
        return Run(run.returncode, run.stdout, run.stderr)

    return call
