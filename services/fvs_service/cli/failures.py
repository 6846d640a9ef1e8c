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
        cause = error.__cause__ if isinstance(error, StorageUnavailableError) else None
        if log_json:
            reason = {} if cause is None else {"reason": reason_of(error)}
            structlog.get_logger().error(error.message, code=error.code, hint=error.hint, **reason)
        else:
            typer.echo(f"Error: {error.message}\n{error.hint}\n{cause or ''}".rstrip(), err=True)
        raise typer.Exit(status) from error
