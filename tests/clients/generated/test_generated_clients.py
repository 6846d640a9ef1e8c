"""Clients that generators make of the OpenAPI document run the whole loop, and have the right types.

`loop.py` and `loop.ts` are what a user writes.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from fvs_service.application import open_storage
from fvs_service.serving.running import running_service
from fvs_service.settings import Settings
from PIL import Image

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

HERE = Path(__file__).resolve().parent
GENERATORS = Path(sys.prefix) / "generators" / "bin"
NODE = Path(sys.executable).with_name("node")
NODE_MODULES = HERE.parents[2] / "clients" / "web" / "node_modules"
_SMALL = {
    "FVS_WORKER__LONG_SIDE_PX": "96",
    "FVS_WORKER__INITIAL_ITERATIONS": "60",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "10",
    "FVS_INSPECTORS": "1",
}


@dataclass(frozen=True)
class Served:
    """A service that needs a key, and photographs for it."""

    url: str
    key: str
    photographs: Path


@pytest.fixture(scope="module")
def generated_for(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("generated")
    camera = SimulatedCamera.like_a_drone(320, 240)
    written = write_photographs(folder / "courtyard", courtyard(), camera, orbit(5, turns=0.2), Monitor())
    with open_storage(Settings(root=folder / "root")) as storage:
        key = storage.keys.create("generated clients")
    with running_service(folder / "root", folder / "service.log", _SMALL) as service:
        yield Served(service.url, key, written[0].parent)


def _run(*words: str | Path, cwd: Path) -> str:
    ended = subprocess.run([*map(str, words)], cwd=cwd, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, f"{words[0]}: {ended.stdout}{ended.stderr}"
    return ended.stdout + ended.stderr


def _require(found: bool, missing: str) -> None:
    if found:
        return
    if os.environ.get("CI") == "true":
        pytest.fail(missing)
    pytest.skip(missing)


def _check(out: Path) -> None:
    with Image.open(out / "best.png") as render:
        assert render.format == "PNG"
    mission = json.loads((out / "mission.json").read_text("utf-8"))
    assert mission["frames"]


@pytest.mark.system
def test_a_python_client_runs_the_loop(generated_for: Served, tmp_path: Path) -> None:
    _require(GENERATORS.is_dir(), "the generators are not installed: make setup")
    generated = _run(
        *(GENERATORS / "openapi-python-client", "generate", "--meta", "none"),
        *("--url", f"{generated_for.url}/openapi.json"),
        *("--config", HERE / "openapi-python-client.yml", "--output-path", tmp_path / "fvs_rest"),
        cwd=tmp_path,
    )
    assert "WARNING" not in generated
    assert "Unable" not in generated
    shutil.copy(HERE / "loop.py", tmp_path)
    python = GENERATORS / "python"
    checked = (
        "--config-file",
        HERE / "mypy.ini",
        "--python-executable",
        python,
        "--cache-dir",
        tmp_path / "cache",
    )
    _run(sys.executable, "-m", "mypy", *checked, "loop.py", "fvs_rest", cwd=tmp_path)
    _run(
        *(python, "loop.py", generated_for.url, generated_for.key, generated_for.photographs, tmp_path),
        cwd=tmp_path,
    )
    _check(tmp_path)


@pytest.mark.system
def test_a_typescript_client_runs_the_loop(generated_for: Served, tmp_path: Path) -> None:
    _require(NODE_MODULES.is_dir(), "the packages of clients/web are not installed: make check-console")
    (tmp_path / "node_modules").symlink_to(NODE_MODULES)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    for name in ("loop.ts", "tsconfig.json"):
        shutil.copy(HERE / name, tmp_path)
    programs = NODE_MODULES / ".bin"
    document = f"{generated_for.url}/openapi.json"
    _run(NODE, programs / "openapi-typescript", document, "--output", "fvs-rest.d.ts", cwd=tmp_path)
    _run(NODE, programs / "tsc", "--project", ".", cwd=tmp_path)
    _run(
        *(NODE, "loop.js", generated_for.url, generated_for.key, generated_for.photographs, tmp_path),
        cwd=tmp_path,
    )
    _check(tmp_path)
