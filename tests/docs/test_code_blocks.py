"""Every code block of the documentation runs as it is written.

A page is one test. Its blocks run in order, in one folder and one shell, against a gateway whose updates
succeed at once; tutorials that need a worker also run against a real ``fvs serve``. The programs that they
start are forks of one process (``warm_programs``). ``_SMALLER`` makes what the pages ask for small enough for
a test. A block that cannot run says why in a comment above it: ``<!-- not run: the reason -->``.
"""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

REPOSITORY = Path(__file__).resolve().parent.parent.parent
PAGES = [
    REPOSITORY / "README.md",
    REPOSITORY / "CONTRIBUTING.md",
    REPOSITORY / "clients" / "python" / "README.md",
    *sorted((REPOSITORY / "docs").rglob("*.md")),
]
_BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<reason>[^\n]+?) -->\n+)?^```(?P<language>[\w-]*)\n(?P<code>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
_SERVICE = "http://127.0.0.1:8000"
_COMMANDS, _SHOWN = {"bash", "python"}, {"text", "console", "javascript", "json"}
_SHORT_TRAINING = "--initial-iterations 20 --iterations-per-view 2 --long-side 64"
_SMALLER = {
    "simulate yard --images 24": "simulate yard --images 6 --size 240x180",
    "simulate site --images 24": "simulate site --images 8 --size 240x180",
    "simulate courtyard --images 24": "simulate courtyard --images 9 --size 240x180",
    "--turns 0.6": "--turns 0.3",
    "0006 0007; do": "0006; do",
    "steps = 3": "steps = 1",
    "--images 60 --turns 2": "--images 12 --turns 0.5 --size 128x96",
    "--budget 20": f"--budget 6 --initial 4 {_SHORT_TRAINING}",
    "--poses known --initial 8": "--poses known",
    "--seeds 0,1,2": f"--seeds 0 --views 4,5 {_SHORT_TRAINING}",
    "median-frequency,farthest,random": "median-frequency,farthest",
    "--views 10 --out yard-travel": f"--views 5 {_SHORT_TRAINING} --out yard-travel",
    "--generator orbit --top 5 --renders views": "--generator orbit --count 5 --renders views",
    '"orbit"}, "top_k": 5': '"orbit", "count": 5}',
    "Orbit(count=24), top_k=5": "Orbit(count=5)",
}
"""Every entry is found in some page."""


@dataclass(frozen=True)
class Block:
    """A fenced block; ``reason`` says why it does not run."""

    line: int
    language: str
    code: str
    reason: str | None


def _blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(text.count("\n", 0, found.start("code")), found["language"], found["code"], found["reason"])
        for found in _BLOCK.finditer(text)
    ]


def _runs(page: Path) -> list[Block]:
    return [block for block in _blocks(page) if block.language in _COMMANDS and block.reason is None]


def _needs_a_worker(page: Path) -> bool:
    return page.parent.name == "tutorials" and any(_SERVICE in block.code for block in _runs(page))


def _id(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three photographs: noise, as nothing is made of them."""
    folder = tmp_path_factory.mktemp("photographs")
    draw = np.random.default_rng(0)
    for number in range(3):
        Image.fromarray(draw.integers(0, 256, (60, 80, 3), np.uint8)).save(folder / f"{number:04d}.jpg")
    return folder


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_every_block_runs_or_says_why_not(page: Path) -> None:
    for block in _blocks(page):
        assert block.language in _COMMANDS | _SHOWN, f"{_id(page)}, line {block.line}: name the language"


def test_what_is_made_smaller_is_there() -> None:
    code = "".join(block.code for page in PAGES for block in _runs(page))
    assert [phrase for phrase in _SMALLER if phrase not in code] == []


@pytest.mark.slow  # half a minute each
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", [page for page in PAGES if _needs_a_worker(page)], ids=_id)
def test_the_blocks_of_tutorials_run_against_a_real_service(
    page: Path, real_service: str, programs: Path, photographs: Path, tmp_path: Path
) -> None:
    _run(page, real_service, programs, photographs, tmp_path)


@pytest.mark.timeout(900)  # a tutorial starts many programs, on whatever machine
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=_id(page), marks=pytest.mark.system if page.parent.name == "tutorials" else ())
        for page in PAGES
        if _runs(page)
    ],
)
def test_the_blocks_run(
    page: Path, played_service: str, programs: Path, photographs: Path, tmp_path: Path
) -> None:
    _run(page, played_service, programs, photographs, tmp_path)


def _run(page: Path, url: str, programs: Path, photographs: Path, tmp_path: Path) -> None:
    if os.environ.get("CI") != "true" and not (shutil.which("curl") and shutil.which("jq")):
        pytest.skip("the pages use curl and jq: apt-get install curl jq")
    shutil.copytree(photographs, tmp_path / "photographs")
    script = ["set -euo pipefail"]
    for block in _runs(page):
        code = block.code
        for phrase, smaller in _SMALLER.items():
            code = code.replace(phrase, smaller)
        code = code.replace(_SERVICE, url)
        script.append(f'echo "[line {block.line}]"')
        if block.language == "python":
            (tmp_path / f"line-{block.line}.py").write_text(code, encoding="utf-8")
            code = f"python -W error line-{block.line}.py"
        script.append(code)
    environment = {
        **os.environ,
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "FVS_URL": url,
        "FVS_ROOT": str(tmp_path / "service"),
    }
    ran = subprocess.run(
        ["bash", "-c", "\n".join(script)],
        cwd=tmp_path,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=800,
        check=False,
    )
    assert ran.returncode == 0, f"{_id(page)}:\n{ran.stdout[-6000:]}"
