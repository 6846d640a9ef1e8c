"""The command line. Commands import the engine when they run, so that ``fvs --help`` is quick."""

import atexit
import gc
import sys

from fvs_engine.cli.exit_codes import INTERRUPTED


def main() -> None:
    """Entry point of the ``fvs`` program."""
    from fvs_engine.cli.app import app

    atexit.register(gc.freeze)  # else the interpreter looks for garbage in the libraries, for a second
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
