"""The program ``fvs-client`` without its commands: the options before them."""

from dataclasses import dataclass
from typing import Annotated

import typer

from fvs_client.default_url import DEFAULT_URL


@dataclass(frozen=True)
class Target:
    """The service that the options before the command name."""

    url: str | None
    api_key: str | None


def program() -> typer.Typer:
    """A new program, which has no command yet."""
    made = typer.Typer(
        help="Upload images to an fvs service, update its model, and rank the next views to photograph.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )
    made.callback()(_options)
    return made


def _options(
    context: typer.Context,
    url: Annotated[
        str | None,
        typer.Option(
            envvar="FVS_URL", help="URL of the service: http(s):// or grpc(s)://.", show_default=DEFAULT_URL
        ),
    ] = None,
    api_key: Annotated[
        str | None,
        typer.Option(
            envvar="FVS_API_KEY",
            show_default=False,
            help="API key. Prefer the variable: arguments are visible to other users.",
        ),
    ] = None,
) -> None:
    """Connect to a service."""
    context.obj = Target(url, api_key)
