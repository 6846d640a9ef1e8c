"""``fvs-client``: the command line of the service."""

import sys

from fvs_client.cli.exit_codes import INTERRUPTED


def main() -> None:
    """Entry point of the ``fvs-client`` program."""
    from fvs_client.cli.app import app

    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
