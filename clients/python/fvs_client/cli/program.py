"""The program ``fvs-client`` without its commands: the options of all of them."""

import importlib.metadata
from dataclasses import dataclass
from typing import Annotated

import typer

from fvs_client.cli.command_group import Program
from fvs_client.service_url import DEFAULT_URL


@dataclass(frozen=True)
class Target:
    """The service that the program's options name."""

    url: str | None
    api_key: str | None


def program() -> typer.Typer:
    """A new program, which has no command yet."""
    made = typer.Typer(
        cls=Program,
        help="Upload images to an fvs service, update its model, and rank the next views to photograph.\n\n"
        "Options may stand before or after the command.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(_options)
    return made


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"fvs-client {importlib.metadata.version('fvs-client')}")
        raise typer.Exit


def _options(
    context: typer.Context,
    url: Annotated[
        str | None,
        typer.Option(envvar="FVS_URL", help="URL of the service: http(s)://.", show_default=DEFAULT_URL),
    ] = None,
    api_key: Annotated[
        str | None,
        typer.Option(
            envvar="FVS_API_KEY",
            show_default=False,
            help="API key. Prefer the variable: arguments are visible to other users.",
        ),
    ] = None,
    version: Annotated[  # noqa: ARG001
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Connect to a service."""
    context.obj = Target(url, api_key)
