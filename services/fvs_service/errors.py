"""Every failure that a caller can cause or meet, with its HTTP and its gRPC status.

Services raise these; the transports turn them into problem documents (RFC 9457) and ``google.rpc`` details
without knowing any of them by name.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from fvs_engine import errors as engine


@dataclass(frozen=True)
class FieldError:
    """One part of the input that is wrong: where (``candidates.3.id``) and why."""

    field: str
    message: str


class ServiceError(Exception):
    """A failure with a stable ``code``; ``retryable`` says whether the same request can succeed later."""

    code: ClassVar[str] = "internal"
    title: ClassVar[str] = "Something went wrong in the service"
    http_status: ClassVar[int] = 500
    grpc_status: ClassVar[str] = "INTERNAL"
    retryable: ClassVar[bool] = True

    def __init__(
        self,
        message: str,
        *,
        hint: str = "",
        errors: Sequence[FieldError] = (),
        retry_after_s: int | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.errors = tuple(errors)
        self.retry_after_s = retry_after_s


class InternalError(ServiceError):
    """A defect of the service; its log has the details under the request's id."""


class MalformedRequestError(ServiceError):
    """The request cannot be read at all."""

    code, title = "malformed-request", "The request cannot be read"
    http_status, grpc_status, retryable = 400, "INVALID_ARGUMENT", False


class UnauthenticatedError(ServiceError):
    """No key, or one that is not known, expired or revoked."""

    code, title = "unauthenticated", "A valid API key is needed"
    http_status, grpc_status, retryable = 401, "UNAUTHENTICATED", False


class ForbiddenError(ServiceError):
    """The key is good, but not for this."""

    code, title = "forbidden", "The API key does not allow this"
    http_status, grpc_status, retryable = 403, "PERMISSION_DENIED", False


class NotFoundError(ServiceError):
    """It does not exist, or belongs to somebody else: both answer alike."""

    code, title = "not-found", "Not found"
    http_status, grpc_status, retryable = 404, "NOT_FOUND", False


class MethodNotAllowedError(ServiceError):
    """The path exists, the method does not."""

    code, title = "method-not-allowed", "The method is not allowed here"
    http_status, grpc_status, retryable = 405, "UNIMPLEMENTED", False


class SlowRequestError(ServiceError):
    """The body stopped coming."""

    code, title = "request-timeout", "The request took too long to arrive"
    http_status, grpc_status, retryable = 408, "DEADLINE_EXCEEDED", True


class ConflictError(ServiceError):
    """The request contradicts the state of what it is about."""

    code, title = "conflict", "The request does not fit the current state"
    http_status, grpc_status, retryable = 409, "FAILED_PRECONDITION", False


class NoSnapshotError(ConflictError):
    """The scene has no model yet."""

    code, title, retryable = "no-snapshot", "The scene has no model yet", True


class StaleLeaseError(ConflictError):
    """Somebody else holds the scene now; whoever meets this must stop."""

    code, title, grpc_status = "stale-lease", "The scene is held by another worker", "ABORTED"


class PayloadTooLargeError(ServiceError):
    """The body is larger than the limit."""

    code, title = "payload-too-large", "The body is too large"
    http_status, grpc_status, retryable = 413, "INVALID_ARGUMENT", False


class UnsupportedMediaTypeError(ServiceError):
    """The body is of a type that this route does not take."""

    code, title = "unsupported-media-type", "The body's type is not supported"
    http_status, grpc_status, retryable = 415, "INVALID_ARGUMENT", False


class RangeError(ServiceError):
    """The range lies outside the artefact."""

    code, title = "range-not-satisfiable", "The range is not satisfiable"
    http_status, grpc_status, retryable = 416, "OUT_OF_RANGE", False

    def __init__(self, size_bytes: int) -> None:
        super().__init__(f"The range lies outside of the {size_bytes} bytes.")
        self.size_bytes = size_bytes


class InvalidRequestError(ServiceError):
    """The request can be read and cannot be used."""

    code, title = "invalid-request", "The request is not valid"
    http_status, grpc_status, retryable = 422, "INVALID_ARGUMENT", False


class DigestMismatchError(InvalidRequestError):
    """The bytes are not those that the digest promised: damaged on the way, or the wrong file."""

    code, title, retryable = "digest-mismatch", "The bytes do not have the digest they should", True


class KeyReusedError(InvalidRequestError):
    """An idempotency key came back with another request."""

    code, title = "idempotency-key-reused", "The idempotency key belongs to another request"


class LimitExceededError(ServiceError):
    """The tenant uses as much as it may; ``retry_after_s`` says when to ask again."""

    code, title = "limit-exceeded", "A limit is reached"
    http_status, grpc_status, retryable = 429, "RESOURCE_EXHAUSTED", True

    def __init__(self, message: str, *, hint: str = "", retry_after_s: int = 5) -> None:
        super().__init__(message, hint=hint, retry_after_s=retry_after_s)


class UnavailableError(ServiceError):
    """No worker can answer now."""

    code, title = "unavailable", "The service cannot answer now"
    http_status, grpc_status, retryable = 503, "UNAVAILABLE", True


class OutOfSpaceError(ServiceError):
    """There is no room left for the bytes."""

    code, title = "out-of-space", "There is no room left"
    http_status, grpc_status, retryable = 507, "RESOURCE_EXHAUSTED", True


_OF_ENGINE: tuple[tuple[type[engine.EngineError], type[ServiceError]], ...] = (
    (engine.InvalidInputError, InvalidRequestError),
    (engine.Cancelled, UnavailableError),
    (engine.BackendUnavailableError, UnavailableError),
)


def from_engine(error: engine.EngineError) -> ServiceError:
    """What a failure of the engine is to a caller of the service."""
    if error.code == "disk-full":
        return OutOfSpaceError(error.message, hint=error.hint)
    for kind, service_kind in _OF_ENGINE:
        if isinstance(error, kind):
            return service_kind(error.message, hint=error.hint)
    return InternalError(error.message, hint=error.hint)
