"""The settings of a command: its options and the environment."""

import difflib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.cli.exit_codes import USAGE

if TYPE_CHECKING:
    from fvs_service.settings import Settings

RootOption = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Folder of the service's data.", show_default="fvs-service"),
]


def settings_of(**given: object) -> "Settings":
    """The settings from the environment and the given ones; ends the program when they are not valid."""
    from pydantic import ValidationError

    from fvs_schema.mistakes import plain_message, sentence
    from fvs_service.environment import PREFIX
    from fvs_service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]
    except OSError as error:
        typer.echo(f"Error: the file that an FVS_…_FILE variable names cannot be read: {error}.", err=True)
        raise typer.Exit(USAGE) from error
    except ValidationError as error:
        for wrong in error.errors():
            variable = PREFIX + "__".join(map(str, wrong["loc"])).upper()
            if wrong["type"] == "extra_forbidden":
                reason = f"{variable}: {_no_setting(variable)}"
            else:
                reason = sentence(variable, plain_message(wrong["type"], wrong["msg"], wrong.get("ctx", {})))
            typer.echo(f"Error: {reason}", err=True)
        raise typer.Exit(USAGE) from error


def _no_setting(variable: str) -> str:
    from fvs_service.environment import PREFIX, variables_of
    from fvs_service.settings import Settings

    # Without the prefix, which all have in common.
    names = [name.removeprefix(PREFIX) for name in variables_of(Settings)]
    nearest = difflib.get_close_matches(variable.removeprefix(PREFIX), names, n=1)
    return "There is no such setting." + "".join(f" Did you mean {PREFIX}{name}?" for name in nearest)
