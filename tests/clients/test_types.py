"""Type checkers and editors find the installed packages from a user's own folder."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
from fvs_client import Client, Orbit

with Client() as client:
    scene = client.scenes.create("quarry")
    ranking = scene.rank(generator=Orbit(count=5), method="kriging")
    reveal_type(ranking.best)
    scene.images.upload("photographs")
    scene.rank(tpo_k=3)
    Orbit(cuont=5)
    Client(timeout_s="long")

from fvs_engine.errors import EngineError

reveal_type(EngineError("no images").code)
"""


@pytest.mark.system
@pytest.mark.process
def test_a_script_elsewhere_is_checked(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-m", "mypy", "--strict", "script.py"]
    checked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    found = [line.partition("script.py:")[2] for line in checked.splitlines() if "script.py:" in line]
    assert [line.partition(":")[0] for line in found if "error:" in line] == ["9", "10", "11"], checked
    assert "RankedCandidate | None" in found[0]
    assert '"tpo_k"' in checked
    assert '"cuont"' in checked
    assert '"str"' in found[-1]
