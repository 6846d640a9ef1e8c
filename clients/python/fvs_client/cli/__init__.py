"""``fvs-client``: the command line of the service."""

import sys
from collections.abc import Sequence

from fvs_client.cli.exit_codes import INTERRUPTED

_OPTIONS = ("--url", "--api-key")
"""The program's options that have a value."""


def main() -> None:
    """Entry point of the ``fvs-client`` program."""
    # On a companion computer the spool starts without what the other commands import.
    if command_of(sys.argv[1:]) == "spool":
        from fvs_client.cli.spool_program import app
    else:
        from fvs_client.cli.app import app

    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def command_of(arguments: Sequence[str]) -> str | None:
    """The command in ``arguments``, behind the program's options; None behind options of a command."""
    left = iter(arguments)
    for argument in left:
        if not argument.startswith("-"):
            return argument
        option, equals, _ = argument.partition("=")
        if option not in _OPTIONS:
            return None
        if not equals:
            next(left, None)
    return None
