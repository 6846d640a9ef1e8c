"""What both programs do: options before or after the command, errors as JSON, help, version, completion."""

import json
import os
from collections.abc import Sequence

import pytest
import typer
from fvs_client.cli.app import app as client
from fvs_client.cli.command_group import Program, arranged
from typer.testing import CliRunner

from fvs_engine.cli.app import app as program

APPS = {"fvs": program, "fvs-client": client}
COMMANDS = {name: typer.main.get_command(app) for name, app in APPS.items()}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("fvs --json info out", "info --json out"),
        ("fvs info out --json", "info out --json"),
        ("fvs --backend cpu --top 3 rank out", "rank --backend cpu --top 3 out"),
        ("fvs --top=3 rank out", "rank --top=3 out"),
        ("fvs rank out --version", "--version rank out"),
        ("fvs --no-gps reconstruct in --out rank", "reconstruct --no-gps in --out rank"),
        ("fvs --out info select data", "select --out info data"),
        ("fvs --size 640x480 simulate out", "simulate --size 640x480 out"),
        ("fvs --size 640 480 simulate-vehicle out", "simulate-vehicle --size 640 480 out"),
        ("fvs --root data keys list", "keys list --root data"),
        ("fvs keys --root data list", "keys list --root data"),
        ("fvs keys --scope read create drone", "keys create --scope read drone"),
        ("fvs-client rank yard --url http://yard", "--url http://yard rank yard"),
        ("fvs-client --url=u --json scenes list --api-key k", "--url=u --api-key k scenes list --json"),
        ("fvs-client jobs --url u wait j --timeout 3", "--url u jobs wait j --timeout 3"),
        ("fvs-client --home plan yard", "plan --home yard"),
        ("fvs-client --home 46.02,7.75 mission rnk_1", "mission --home 46.02,7.75 rnk_1"),
        ("fvs-client --origin -1 -2 -3 scenes create x", "scenes create --origin -1 -2 -3 x"),
        ("fvs-client -f csv mission rnk_1", "mission -f csv rnk_1"),
        ("fvs-client mission rnk_1 -fcsv --url u", "--url u mission rnk_1 -fcsv"),
        ("fvs-client rank --top 3 -- --url", "rank --top 3 -- --url"),
        ("fvs-client rank -h", "rank -h"),
        ("fvs-client -h rank", "-h rank"),
        ("fvs-client jobs -h", "jobs -h"),
        # Where there is no such command or option, all stays as it is.
        ("fvs --top 3 info out", "--top 3 info out"),
        ("fvs-client --tpo 3 rank yard", "--tpo 3 rank yard"),
        ("fvs-client --json nothing", "--json nothing"),
        ("fvs-client rank yard --tpo 3", "rank yard --tpo 3"),
        ("fvs-client --url", "--url"),
    ],
)
def test_options_stand_before_or_after_the_command(line: str, expected: str) -> None:
    name, *words = line.split()
    root = COMMANDS[name]
    assert arranged(root, words) == expected.split()  # type: ignore[arg-type]


def _error(name: str, words: Sequence[str]) -> dict[str, str]:
    result = CliRunner().invoke(APPS[name], words)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    return dict(json.loads(line)["error"])


@pytest.mark.parametrize(
    ("line", "reason", "command"),
    [
        ("fvs rank --json", "Missing argument 'DIR'", "fvs rank"),
        ("fvs --json rank out --top 0", "Invalid value for '--top': it must be at least 1", "fvs rank"),
        ("fvs-client rank x --top 1.5 --json", "'--top': it must be a whole number", "fvs-client rank"),
        (
            "fvs-client rank x --generator disc --json",
            "'--generator': 'disc' is not one of",
            "fvs-client rank",
        ),
        ("fvs --json nothing", "--json", "fvs"),
        ("fvs evaluate data --out out --seeds x --json", "not a list of whole numbers", "fvs evaluate"),
        ("fvs keys --json create", "--json", "fvs keys"),
        ("fvs-client scenes create --json", "Missing argument", "fvs-client scenes create"),
        ("fvs-client --json rank x --radius 3", "--radius needs --current", "fvs-client rank"),
        ("fvs-client jobs lst --json", "Did you mean 'list'", "fvs-client jobs"),
        ("fvs-client scenes create x --origin 99 0 0 --json", "99.0 is not", "fvs-client scenes create"),
        ("fvs-client upload x no-folder --json", "path 'no-folder' does not exist", "fvs-client upload"),
        ("fvs-client --url nowhere status --json", "is not the URL of a service", "fvs-client status"),
    ],
)
def test_wrong_usage_is_json_where_json_is_asked_for(line: str, reason: str, command: str) -> None:
    name, *words = line.split()
    error = _error(name, words)
    assert error["code"] == "usage"
    assert reason in error["message"]
    described = error["hint"].replace("`root ", f"`{name} ")
    assert described == f"`{command} --help` describes the options."


def test_names_that_are_no_text_are_escaped_on_stdout() -> None:
    app = typer.Typer(cls=Program)

    @app.command()
    def files() -> None:
        typer.echo(json.dumps(os.fsdecode(b"caf\xe9.jpg"), ensure_ascii=False))

    @app.callback()
    def group() -> None: ...

    result = CliRunner().invoke(app, ["files"])
    assert result.exit_code == 0, result.output
    assert result.stdout == '"caf\\udce9.jpg"\n'


@pytest.mark.parametrize("name", APPS)
def test_help_and_version(name: str) -> None:
    for words in (["-h"], ["--help"], ["rank", "-h"]):
        result = CliRunner().invoke(APPS[name], words)
        assert result.exit_code == 0, result.output
        assert "Usage:" in result.stdout
    for words in (["--version"], ["rank", "--version"]):
        assert CliRunner().invoke(APPS[name], words).stdout == f"{name} 0.1.0\n"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("fvs-client --json ra", {"rank", "rankings"}),
        ("fvs-client --json plan yard --url u --generator ", {"orbit", "grid", "dataset", "in-volume"}),
        (
            "fvs --json rank out --method median-frequency-",
            {"median-frequency-fast", "median-frequency-estimate"},
        ),
        ("fvs-client rank yard --method k", {"kriging"}),
        ("fvs-client spool st", {"status"}),
    ],
)
def test_a_shell_completes_words(line: str, expected: set[str]) -> None:
    words = line.split(" ")
    name = words[0]
    variable = f"_{name.replace('-', '_').upper()}_COMPLETE"
    environment = {variable: "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    found = CliRunner().invoke(APPS[name], [], prog_name=name, env=environment)
    assert set(found.stdout.split()) == expected, found.output
