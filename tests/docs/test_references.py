"""What the documentation names exists: files, modules, commands, options, variables."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
from fvs_client.cli import error_exit_codes, exit_codes
from fvs_client.cli.app import app as fvs_client
from fvs_service.environment import OF_OTHERS, variables_of
from fvs_service.settings import BlobSettings, Retention, Settings, WorkerSettings

from fvs_engine.cli.app import app as fvs
from fvs_schema.field_docstrings import field_docstrings
from fvs_schema.service import Limits

REPOSITORY = Path(__file__).resolve().parent.parent.parent
PAGES = [
    *(REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "clients/python/README.md")),
    *sorted((REPOSITORY / "docs").rglob("*.md")),
]
_PATH = re.compile(
    r"(?<![\w./-])((?:fvs_engine|services|clients|tests|benchmarks|docs|demo)/[\w./-]*[\w/])(?![\w*<])"
)
_MODULE = re.compile(r"`((?:fvs_engine|fvs_service|fvs_client)(?:\.\w+)+)`")
_CODE = re.compile(r"^```\w*\n(.*?)^```$|`([^`\n]+)`", re.DOTALL | re.MULTILINE)
_COMMAND = re.compile(r"(?:^|[$(|&;]) *((?:fvs|fvs-client) +[a-z-][^\n)|&>;]*)", re.MULTILINE)
_VARIABLE = re.compile(r"`(FVS_[A-Z_]+)`")
_ROOTS = {
    "fvs_engine": "fvs_engine",
    "fvs_service": "services/fvs_service",
    "fvs_client": "clients/python/fvs_client",
}


def _id(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_paths_exist(page: Path) -> None:
    named = {found.rstrip("/") for found in _PATH.findall(page.read_text(encoding="utf-8"))}
    assert sorted(path for path in named if not (REPOSITORY / path).exists()) == []


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_modules_exist(page: Path) -> None:
    missing = []
    for name in _MODULE.findall(page.read_text(encoding="utf-8")):
        root, *parts = name.split(".")
        folder = REPOSITORY / _ROOTS[root]
        while parts and (folder / parts[0]).is_dir():
            folder = folder / parts.pop(0)
        source = folder / f"{parts[0]}.py" if parts else folder / "__init__.py"
        if not source.is_file():  # a name that the package exports
            source = folder / "__init__.py"
            missing += [name] if parts[0] not in source.read_text(encoding="utf-8") else []
        elif parts[1:] and parts[1] not in source.read_text(encoding="utf-8"):
            missing.append(name)
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_commands_and_options_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    code = "\n".join("".join(pieces) for pieces in _CODE.findall(text))
    for found in _COMMAND.findall(code):
        line = re.split(r"\s{3,}|\s#", found.strip())[0]
        words = shlex.split(line.replace("'", ""))
        program, rest = words[0], words[1:]
        command: Any = typer.main.get_command(fvs if program == "fvs" else fvs_client)
        while rest and hasattr(command, "commands"):
            if not re.fullmatch(r"[a-z][a-z-]*", rest[0]):
                break
            name = rest.pop(0)
            assert name in command.commands, line
            command = command.commands[name]
        options = {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        } | {"--help", "-h"}
        assert {word.split("=")[0] for word in rest if word.startswith("--")} <= options, line


@pytest.mark.parametrize("page", PAGES, ids=_id)
def test_variables_are_settings(page: Path) -> None:
    named = set(_VARIABLE.findall(page.read_text(encoding="utf-8")))
    assert named <= {*variables_of(Settings), *OF_OTHERS}


def test_settings_have_docstrings() -> None:
    documented = {**field_docstrings(Settings.__module__), **field_docstrings(Limits.__module__)}
    missing = [
        f"{kind.__name__}.{name}"
        for kind in (Settings, Limits, BlobSettings, WorkerSettings, Retention)
        for name, field in kind.model_fields.items()
        if not hasattr(field.annotation, "model_fields") and name not in documented[kind.__name__]
    ]
    assert missing == []


def test_exit_statuses_of_the_client_are_those_of_the_program() -> None:
    used = {status for _, status in error_exit_codes._STATUSES}
    used |= {value for name, value in vars(exit_codes).items() if name.isupper()}
    listed = (REPOSITORY / "docs" / "reference" / "exit-statuses.md").read_text(encoding="utf-8")
    listed = listed.split("## fvs-client")[1]
    assert {int(status) for status in re.findall(r"^\| (\d+) \|", listed, re.MULTILINE)} == used
