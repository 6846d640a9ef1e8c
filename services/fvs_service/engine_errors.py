"""Conversion of the engine's errors to the service's."""

from fvs_engine.errors import BackendUnavailableError, Cancelled, EngineError, InvalidInputError
from fvs_service.disclosure import without_paths
from fvs_service.errors import (
    InternalError,
    InvalidRequestError,
    OutOfSpaceError,
    ServiceError,
    UnavailableError,
)

_OF_ENGINE: tuple[tuple[type[EngineError], type[ServiceError]], ...] = (
    (InvalidInputError, InvalidRequestError),
    (Cancelled, UnavailableError),
    (BackendUnavailableError, UnavailableError),
)


def from_engine(error: EngineError) -> ServiceError:
    """The service's error for one of the engine's, with file names in place of paths."""
    message, hint = without_paths(error.message), without_paths(error.hint)
    if error.code == "disk-full":
        return OutOfSpaceError("The disk is full.")
    for kind, service_kind in _OF_ENGINE:
        if isinstance(error, kind):
            return service_kind(message, hint=hint)
    return InternalError(message, hint=hint)
