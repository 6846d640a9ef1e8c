"""Benchmarks and the demonstration use names that exist: most take too long to be run by tests."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("fvs_engine", "fvs_service", "fvs_client")
PROGRAMS = sorted([*ROOT.glob("benchmarks/**/*.py"), *ROOT.glob("demo/*.py")])


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_what_it_imports_exists(program: Path) -> None:
    imports = [
        node
        for node in ast.walk(ast.parse(program.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(OURS)
    ]
    for node in imports:
        module = importlib.import_module(str(node.module))
        for name in node.names:
            if not hasattr(module, name.name):  # else it must be a module
                importlib.import_module(f"{node.module}.{name.name}")
