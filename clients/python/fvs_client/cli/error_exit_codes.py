"""Exit codes of errors of the client."""

from fvs_client.cli.exit_codes import UNAVAILABLE, USAGE
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
from fvs_client.height_model import HeightModelError
from fvs_schema.error_codes import ErrorCode


class SceneNameError(FvsError):
    """A scene's name is ambiguous, or taken."""

    code = ErrorCode.USAGE


_STATUSES: tuple[tuple[type[FvsError], int], ...] = (
    (UnauthenticatedError, 5),
    (NotFoundError, 6),
    (UnavailableError, UNAVAILABLE),
    (DeadlineExceededError, UNAVAILABLE),
    (ApiError, 3),
    (ConnectionFailedError, UNAVAILABLE),
    (JobFailedError, 7),
    (JobCanceledError, 8),
    (WaitTimeoutError, 9),
    (SceneNameError, USAGE),
    (HeightModelError, USAGE),
    (FvsError, 3),
)


def exit_code_of(error: FvsError) -> int:
    """Exit code for an error."""
    return next(status for kind, status in _STATUSES if isinstance(error, kind))
