"""Every numeric command-line option has a range; values outside it are refused with the option's name."""

from collections.abc import Iterator
from typing import Any

import pytest
import typer
from fvs_client.cli.app import app as client
from typer.testing import CliRunner

from fvs_engine.cli.app import app as program
from fvs_engine.cli.options import MAX_SIDE_PX
from fvs_engine.images import limits

EXTREMES = ("nan", "inf", "-inf", "1e308", "-1e308", "9" * 400, "-" + "9" * 400)


def _numbers(command: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every option with numbers, and the command that has it."""
    for name, inner in getattr(command, "commands", {}).items():
        yield from _numbers(inner, (*path, name))
    for parameter in command.params:
        kind = str(parameter.type_descriptor.annotation)
        if "int" in kind or "float" in kind:
            yield path, parameter


COMMANDS = {"fvs": typer.main.get_command(program), "fvs-client": typer.main.get_command(client)}
"""Built once: ``CliRunner`` would build them from a hundred functions for every call."""
OPTIONS = {
    " ".join((name, *path, option.opts[0])): (command, path, option)
    for name, command in COMMANDS.items()
    for path, option in _numbers(command, ())
}


def test_options_are_found() -> None:
    assert len(OPTIONS) > 50


def test_the_command_line_takes_the_sizes_that_images_may_have() -> None:
    assert MAX_SIDE_PX == limits.MAX_SIDE_PX


@pytest.mark.parametrize("name", OPTIONS)
def test_numbers_outside_of_the_range_are_refused(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")
    command, path, option = OPTIONS[name]
    outside = [*EXTREMES]
    if option.nargs == 1:
        assert option.min is not None
        assert option.max is not None
        outside += [str(option.min - 1), str(option.max + 1)]
    for text in outside:
        given = (
            [f"{option.opts[0]}={text}"] if option.nargs == 1 else [option.opts[0], *[text] * option.nargs]
        )
        with pytest.raises(SystemExit) as ended:
            command.main([*path, *given])
        said = capsys.readouterr().err
        assert ended.value.code == 2, (text, said)
        assert option.opts[0] in said, text


@pytest.mark.parametrize("option", ["--seeds", "--views"])
@pytest.mark.parametrize("numbers", ["-1", "1,99999999999", "9" * 5000, "nan", "1,,2"])
def test_lists_of_numbers_have_a_range_too(option: str, numbers: str) -> None:
    result = CliRunner().invoke(program, ["evaluate", "folder", "--out", "out", f"{option}={numbers}"])
    assert result.exit_code == 2
    assert option in result.output
