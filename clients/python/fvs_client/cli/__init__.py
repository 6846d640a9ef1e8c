"""``fvs-client``: the command line of the service."""

import sys
from collections.abc import Sequence

from fvs_client.cli.exit_codes import INTERRUPTED


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
    """The command in ``arguments``: what follows the program's options, each of which has a value."""
    left = iter(arguments)
    for argument in left:
        if not argument.startswith("-"):
            return argument
        if "=" not in argument:
            next(left, None)
    return None
