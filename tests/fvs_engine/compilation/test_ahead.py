"""Kernels are compiled by a child process; nobody runs what it compiled itself. A tiny package stands in."""

import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fvs_engine.compilation import ahead as compilation
from fvs_engine.compilation.ahead import ensure_compiled
from fvs_engine.compilation.kernels import KERNELS
from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor, Progress

INNER = """
from fvs_engine.compilation.kernels import inlined_kernel

@inlined_kernel
def inner(x):
    return x + 1
"""
OUTER = """
from fvs_engine.compilation.kernels import kernel
from tiny.inner import inner

@kernel
def outer(x):
    return 10 * inner(x)
"""
WARM_UP = """
from tiny.outer import outer

STEPS = (lambda: outer(1),)
"""
RUN = """
import json
from fvs_engine.compilation.ahead import ensure_compiled
from fvs_engine.compilation.kernels import KERNELS
from fvs_engine.monitor import Monitor
from tiny.outer import outer

reports = []
ensure_compiled("tiny.warm_up", outer, Monitor(lambda progress: reports.append(progress.stage)))
found = outer(4)
compiled = [k.__name__ for k in KERNELS if hasattr(k, "stats") and sum(k.stats.cache_misses.values())]
print(json.dumps({"found": found, "compiled_here": compiled, "reports": reports}))
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of the package ``tiny``, which this process and its children can import."""
    folder = tmp_path / "tiny"
    folder.mkdir()
    for name, text in (("__init__", ""), ("inner", INNER), ("outer", OUTER), ("warm_up", WARM_UP)):
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(compilation, "_ready", set())
    yield folder
    forget_imports()


def forget_imports() -> None:
    """Forget the package ``tiny``: the next import reads its files again."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "tiny"]:
        del sys.modules[name]
    importlib.invalidate_caches()


def start(**environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", RUN], stdout=subprocess.PIPE, text=True, env=os.environ | environment
    )


def result(process: "subprocess.Popen[str]") -> Any:
    out, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    return json.loads(out)


def run_here() -> Any:
    """What ``RUN`` prints, from this process as if it had just started; starting one takes longer."""
    forget_imports()
    compilation._ready.discard("tiny.warm_up")
    known = len(KERNELS)
    try:
        imported, reports = outer(), []
        ensure_compiled("tiny.warm_up", imported, Monitor(lambda progress: reports.append(progress.stage)))
        found = imported(4)
        compiled = [k.__name__ for k in KERNELS[known:] if sum(k.stats.cache_misses.values())]
    finally:
        del KERNELS[known:]
    return {"found": found, "compiled_here": compiled, "reports": reports}


def outer() -> Callable[[int], int]:
    function: Callable[[int], int] = importlib.import_module("tiny.outer").outer
    return function


@pytest.mark.system
@pytest.mark.usefixtures("package")
def test_two_processes_at_once_load_what_one_child_compiled_and_a_third_needs_no_child() -> None:
    both = [start(), start()]
    for first in map(result, both):
        assert first["found"] == 50
        assert first["compiled_here"] == []
        assert set(first["reports"]) == {"compile"}
    assert run_here() == {"found": 50, "compiled_here": [], "reports": []}


@pytest.mark.system
def test_what_was_lost_or_depends_on_a_change_is_compiled_again_and_nothing_else(package: Path) -> None:
    """A change of a constant, and one in an inlined kernel, both in other files than the kernel's."""
    (package / "apart.py").write_text(INNER.replace("def inner", "def apart"))
    (package / "constants.py").write_text("TEN = 10\n")
    (package / "outer.py").write_text(
        OUTER.replace("10 *", "TEN *").replace("import inner", "import inner\nfrom tiny.constants import TEN")
    )
    with (package / "warm_up.py").open("a") as warm_up:
        warm_up.write("from tiny.apart import apart\nSTEPS += (lambda: apart(1),)\n")
    assert run_here()["found"] == 50
    (apart,) = (package / "__pycache__").glob("apart.apart*.nbc")
    before = apart.stat().st_mtime_ns
    (package / "constants.py").write_text("TEN = 1000\n")
    assert run_here()["found"] == 5000
    (package / "inner.py").write_text(INNER.replace("x + 1", "x + 200"))
    changed = run_here()
    assert changed["found"] == 204_000
    assert changed["compiled_here"] == []
    for data in (package / "__pycache__").glob("outer.outer*.nbc"):
        data.unlink()
    again = run_here()
    assert again["reports"]
    assert again["compiled_here"] == []
    assert apart.stat().st_mtime_ns == before


@pytest.mark.usefixtures("package")
def test_nothing_to_compile_where_numba_is_off() -> None:
    found = result(start(NUMBA_DISABLE_JIT="1"))
    assert found == {"found": 50, "compiled_here": [], "reports": []}


@pytest.mark.system
def test_cancelling_ends_the_child(package: Path) -> None:
    (package / "warm_up.py").write_text("import time\n\nSTEPS = (lambda: time.sleep(120),)\n")

    def stop(progress: Progress) -> None:
        assert progress.stage == "compile"
        monitor.cancel()

    monitor = Monitor(stop)
    begun = time.monotonic()
    with pytest.raises(Cancelled):
        ensure_compiled("tiny.warm_up", outer(), monitor)
    assert time.monotonic() - begun < 30
    (package / "warm_up.py").write_text(WARM_UP)
    assert run_here()["compiled_here"] == []


def test_a_child_that_fails_costs_only_the_promise(package: Path, caplog: pytest.LogCaptureFixture) -> None:
    (package / "warm_up.py").write_text("raise OSError('no space left')\n")
    ensure_compiled("tiny.warm_up", outer())
    assert "no space left" in caplog.text
    assert outer()(4) == 50
