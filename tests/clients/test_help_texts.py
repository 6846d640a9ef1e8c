"""What ``--help`` prints of every command is what the sources say: nothing is taken for markup and lost."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from fvs_client.cli.app import app as client

from fvs_engine.cli.app import app as program

COMMANDS = {"fvs": typer.main.get_command(program), "fvs-client": typer.main.get_command(client)}
"""Built once: ``CliRunner`` would build them from a hundred functions for every call."""


def _commands(command: Any, path: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...], Any]]:
    """Every command below ``command``, with its name and the words that call it."""
    yield " ".join(path), path[1:], command
    for name, inner in getattr(command, "commands", {}).items():
        yield from _commands(inner, (*path, name))


ALL = {
    name: (root, words, command)
    for program_name, root in COMMANDS.items()
    for name, words, command in _commands(root, (program_name,))
}


def _words(text: str) -> str:
    """The text without the lines of boxes and tables, on one line."""
    return re.sub(r"[│╭╮╰╯─\s]+", " ", text)


@pytest.mark.parametrize("name", ALL)
def test_help_is_printed_as_it_is_written(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    root, words, command = ALL[name]
    width = 400
    monkeypatch.setattr("typer.rich_utils.MAX_WIDTH", width)
    monkeypatch.setenv("COLUMNS", str(width))
    with pytest.raises(SystemExit) as ended:
        root.main([*words, "--help"])
    assert ended.value.code == 0
    printed = _words(capsys.readouterr().out)
    paragraphs = (command.help or "").split("\n\n")
    options = [parameter.help for parameter in command.params if getattr(parameter, "help", None)]
    shown = [str(parameter.show_default) for parameter in command.params if _has_text(parameter)]
    metavars = [parameter.metavar for parameter in command.params if parameter.metavar]
    for text in (*paragraphs, *options, *shown, *metavars):
        assert _words(text).strip() in printed
    for text in options:
        assert text[0].isupper() or re.match(r"[a-z]\w*:|…", text), text
        assert text[-1] in ".…", text


def _has_text(parameter: Any) -> bool:
    return isinstance(getattr(parameter, "show_default", None), str)


def test_mission_and_fly_have_the_same_options_for_the_same_things() -> None:
    commands = COMMANDS["fvs-client"].commands
    mission, fly = (
        {parameter.opts[0]: parameter for parameter in commands[name].params} for name in ("mission", "fly")
    )
    for name in ("--transit-height", "--lowest", "--highest", "--geofence", "--speed"):
        assert mission[name].metavar == fly[name].metavar
        assert mission[name].nargs == fly[name].nargs
