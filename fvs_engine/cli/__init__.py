"""The command line. Commands import the engine when they run, so that ``fvs --help`` is quick."""

import sys

from fvs_engine.cli.exit_codes import INTERRUPTED


def main() -> None:
    """Entry point of the ``fvs`` program."""
    from fvs_engine.cli.app import app

    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
