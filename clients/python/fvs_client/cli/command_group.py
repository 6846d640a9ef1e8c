"""The group of commands of the programs ``fvs`` and ``fvs-client``, and how they print errors.

Options may stand before or after the command that they belong to. With ``--json``, wrong usage is an error as
JSON, as all others are.
"""

import io
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

_HELP = ("-h", "--help")
_PLAIN_WORDS = (
    ("Value error, ", ""),
    (", unable to parse string as an integer", ""),
    (", unable to parse string as a number", ""),
    ("Input should be a valid integer", "it must be a whole number"),
    ("Input should be a valid number", "it must be a number"),
    ("Input should be", "it must be"),
    ("greater than or equal to", "at least"),
    ("less than or equal to", "at most"),
)
"""What pydantic, which reads the values of options, says and what users are told."""


class Program(TyperGroup):
    """The group of a program's commands."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: Any = None, **settings: Any
    ) -> Any:
        """See ``TyperGroup``, which expects each option behind its command."""
        as_json = "--json" in args
        _allow_names_in_any_encoding()
        with _usage_errors(as_json=as_json):
            self.check(args)
            context = super().make_context(info_name, arranged(self, args), parent, **settings)
        context.meta[__name__] = as_json
        return context

    def check(self, arguments: Sequence[str]) -> None:
        """Raise ``TyperException`` for arguments that no command of the program takes."""

    def invoke(self, ctx: Any) -> Any:
        """See ``TyperGroup``."""
        with _usage_errors(ctx, as_json=ctx.meta[__name__]):
            return super().invoke(ctx)


def print_error(code: str, message: str, hint: str, **details: Any) -> None:
    """Print an error as JSON, on one line of stderr."""
    document = {"code": code, "message": message, "hint": hint, **details}
    typer.echo(json.dumps({"error": document}, ensure_ascii=False), err=True)


def _allow_names_in_any_encoding() -> None:
    """Let stdout escape what is not UTF-8 in names of files, as stderr does, instead of failing."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


@contextmanager
def _usage_errors(running: Any = None, *, as_json: bool) -> Iterator[None]:
    """Reword wrong usage, and print it as JSON; ``running`` is the context in which a command runs."""
    try:
        yield
    except TyperException as error:
        for words, plain in _PLAIN_WORDS:
            error.message = error.message.replace(words, plain)
        if not as_json:
            raise
        context, command = getattr(error, "ctx", None), ""
        if context is not None:
            command = context.command_path
        elif running is not None:
            command = f"{running.command_path} {running.invoked_subcommand}"
        print_error("usage", error.format_message(), command and f"`{command} --help` describes the options.")
        raise typer.Exit(error.exit_code) from error


def arranged(program: TyperGroup, arguments: Sequence[str]) -> list[str]:
    """``arguments`` with each option behind the nearest of the commands that have it.

    They stay as they are where they name no command: the program then says what is wrong.
    """
    places = _places(program, [program], arguments, 0, ())
    if places is None:
        return list(arguments)
    commands: list[Any] = [program]
    words: list[list[str]] = [[]]
    for place in places:
        commands.append(commands[-1].commands[arguments[place]])
        words.append([arguments[place]])
    start = level = 0
    while start < len(arguments) and arguments[start] != "--":
        if start in places:
            level, start = level + 1, start + 1
            continue
        owner, values = _owner(commands, level, arguments[start])
        words[owner] += arguments[start : start + 1 + values]
        start += 1 + values
    words[level] += arguments[start:]
    return [word for part in words for word in part]


def _places(
    program: TyperGroup,
    commands: Sequence[Any],
    arguments: Sequence[str],
    start: int,
    early: tuple[tuple[str, int], ...],
) -> tuple[int, ...] | None:
    """The indices of the command and of the groups around it; None where there is none.

    ``early`` are the options before ``start``, with the numbers of their values: the commands must have them.
    """
    if start >= len(arguments) or arguments[start] == "--":
        return None
    word = arguments[start]
    if word.startswith("-"):
        known = (_values(command, word) for command in _all(program))
        for values in sorted({number for number in known if number is not None}):
            found = _places(program, commands, arguments, start + 1 + values, (*early, (word, values)))
            if found is not None:
                return found
        return None
    command = commands[-1].commands.get(word)
    if command is None:
        return None
    below = None
    named = [*commands, command]
    if isinstance(command, TyperGroup):
        below = _places(program, named, arguments, start + 1, early)
    if below is not None:
        return (start, *below)
    fits = all(any(_values(one, option) == values for one in named) for option, values in early)
    return (start,) if fits else None


def _owner(commands: Sequence[Any], level: int, word: str) -> tuple[int, int]:
    """Which of ``commands`` a word behind the one at ``level`` belongs to, and how many values follow it."""
    around = [*range(level, -1, -1), *range(level + 1, len(commands))]
    for index in around:
        values = _values(commands[index], word)
        if values is not None:
            return index, values
    return level, 0


def _values(command: Any, word: str) -> int | None:
    """How many words after ``word`` are its values; None if it is no option of ``command``."""
    name, equals, _ = word.partition("=") if word.startswith("--") else (word[:2], word[2:], "")
    if name in _HELP:
        return 0
    for option in command.params:
        if name.startswith("-") and name in (*option.opts, *option.secondary_opts):
            return 0 if equals or getattr(option, "is_flag", False) else int(option.nargs)
    return None


def _all(command: Any) -> Iterator[Any]:
    yield command
    for inner in getattr(command, "commands", {}).values():
        yield from _all(inner)
