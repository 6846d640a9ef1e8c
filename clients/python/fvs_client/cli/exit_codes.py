"""Exit codes of ``fvs-client``. They are never reassigned."""

from fvs_client.errors import (
    ApiError,
    ConnectionFailedError,
    DeadlineExceededError,
    FvsError,
    JobCanceledError,
    JobFailedError,
    NotFoundError,
    UnauthenticatedError,
    UnavailableError,
    WaitTimeoutError,
)

OK = 0
BUG = 1
USAGE = 2
SOME_FILES = 10
"""Some files were not uploaded, or cannot be used."""
INTERRUPTED = 130

_STATUSES: tuple[tuple[type[FvsError], int], ...] = (
    (UnauthenticatedError, 5),
    (NotFoundError, 6),
    (UnavailableError, 4),
    (DeadlineExceededError, 4),
    (ApiError, 3),
    (ConnectionFailedError, 4),
    (JobFailedError, 7),
    (JobCanceledError, 8),
    (WaitTimeoutError, 9),
    (FvsError, 3),
)


def exit_code_of(error: FvsError) -> int:
    """Exit code for an error."""
    return next(status for kind, status in _STATUSES if isinstance(error, kind))
