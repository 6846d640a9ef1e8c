"""Expected failures of the service's commands: a message with its hint, and an exit status."""

import contextlib
from collections.abc import Iterator

import typer

from fvs_engine.cli.exit_codes import USAGE


@contextlib.contextmanager
def failures_as_messages(status: int = USAGE, *, log_json: bool = False) -> Iterator[None]:
    """Print an expected error and end the program with ``status``; ``log_json``: as a line of the log.

    When a storage cannot be reached, its own words follow, in a line of the log as ``reason``.
    """
    import structlog

    from fvs_engine.errors import EngineError
    from fvs_service.errors import ServiceError, StorageUnavailableError
    from fvs_service.logs import reason_of

    try:
        yield
    except (EngineError, ServiceError) as error:
        away = isinstance(error, StorageUnavailableError) and error.__cause__ is not None
        reason = {"reason": reason_of(error)} if away else {}
        if log_json:
            structlog.get_logger().error(error.message, code=error.code, hint=error.hint, **reason)
        else:
            said = (error.message, error.hint, *reason.values())
            typer.echo("Error: " + "\n".join(filter(None, said)), err=True)
        raise typer.Exit(status) from error
