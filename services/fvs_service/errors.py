"""The errors of the service, each with its code, its HTTP status and its gRPC status.

Services raise these errors; the transports turn them into problem documents (RFC 9457) and into
``google.rpc.Status`` without naming any of them.
"""

from collections.abc import Sequence
from typing import ClassVar

from fvs_schema.error_codes import ErrorCode, FieldError


class ServiceError(Exception):
    """A failure with a stable ``code``; ``retryable``: the same request can succeed later.

    Subclasses set what differs from their base as keyword arguments of the class statement. Each has a
    ``usual_hint`` of its own or of its base.
    """

    code: ClassVar[ErrorCode] = ErrorCode.INTERNAL
    title: ClassVar[str] = "Something went wrong in the service"
    status: ClassVar[int] = 500
    rpc_status: ClassVar[str] = "INTERNAL"
    retryable: ClassVar[bool] = True
    usual_hint: ClassVar[str] = ""
    """The hint of errors that have none of their own."""

    def __init_subclass__(
        cls,
        *,
        code: str | None = None,
        title: str | None = None,
        status: int | None = None,
        rpc_status: str | None = None,
        retryable: bool | None = None,
        usual_hint: str | None = None,
    ) -> None:
        super().__init_subclass__()
        cls.code = cls.code if code is None else ErrorCode(code)
        cls.title = cls.title if title is None else title
        cls.status = cls.status if status is None else status
        cls.rpc_status = cls.rpc_status if rpc_status is None else rpc_status
        cls.retryable = cls.retryable if retryable is None else retryable
        cls.usual_hint = cls.usual_hint if usual_hint is None else usual_hint

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
        self.hint = hint or self.usual_hint
        self.errors = tuple(errors)
        self.retry_after_s = retry_after_s

    @property
    def blames_request(self) -> bool:
        """Whether the request is wrong in itself, whatever the state of the service."""
        return not self.retryable and self.status in (400, 413, 415, 422)


class InternalError(ServiceError, usual_hint="Try again; if it fails again, report the request_id."):
    """A defect of the service; the log has the details under the request's id."""


class MalformedRequestError(
    ServiceError,
    code="malformed-request",
    title="The request cannot be read",
    status=400,
    rpc_status="INVALID_ARGUMENT",
    retryable=False,
    usual_hint="GET /openapi.json and the protos describe the requests.",
):
    """The request cannot be parsed."""


class UnauthenticatedError(
    ServiceError,
    code="unauthenticated",
    title="A valid API key is needed",
    status=401,
    rpc_status="UNAUTHENTICATED",
    retryable=False,
    usual_hint="Set FVS_API_KEY for fvs-client; otherwise send Authorization: Bearer fvs_…",
):
    """No key, or one that is unknown, expired or revoked."""


class ForbiddenError(
    ServiceError,
    code="forbidden",
    title="The API key does not allow this",
    status=403,
    rpc_status="PERMISSION_DENIED",
    retryable=False,
    usual_hint="Use a key that has the scope: fvs keys list shows keys with their scopes.",
):
    """The key is valid but lacks the scope."""


class ForeignOriginError(
    ServiceError,
    code="foreign-origin",
    title="Pages of this origin are not allowed",
    status=403,
    rpc_status="PERMISSION_DENIED",
    retryable=False,
    usual_hint="Send the request without a browser, or from a page of the service's own origin.",
):
    """A browser sent the request for a page of another origin."""


class UnknownHostError(
    ServiceError,
    code="unknown-host",
    title="The host name is not known",
    status=421,
    rpc_status="PERMISSION_DENIED",
    retryable=False,
    usual_hint="Use the name that the service is configured for.",
):
    """The request's ``Host`` is not a name of the service."""


class NotFoundError(
    ServiceError,
    code="not-found",
    title="Not found",
    status=404,
    rpc_status="NOT_FOUND",
    retryable=False,
    usual_hint="Check the id. It may have been deleted, or be out of reach of this API key.",
):
    """The resource does not exist or belongs to another tenant: the responses are the same."""


class MethodNotAllowedError(
    ServiceError,
    code="method-not-allowed",
    title="The method is not allowed here",
    status=405,
    rpc_status="UNIMPLEMENTED",
    retryable=False,
    usual_hint="GET /openapi.json lists the methods of every path.",
):
    """The path exists, the method does not."""


class SlowRequestError(
    ServiceError,
    code="request-timeout",
    title="The request took too long to arrive",
    status=408,
    rpc_status="UNAVAILABLE",
    usual_hint="Send the request again.",
):
    """The body stopped arriving, or arrived too slowly."""


class ConflictError(
    ServiceError,
    code="conflict",
    title="The request conflicts with the current state",
    status=409,
    rpc_status="FAILED_PRECONDITION",
    retryable=False,
    usual_hint="Read the resource: its state shows what is possible now.",
):
    """The request contradicts the state of its resource."""


class OffsetMismatchError(
    ConflictError,
    code="offset-mismatch",
    title="The upload continues at another offset",
    rpc_status="ABORTED",
    usual_hint="Ask for the upload's offset, and continue from there.",
):
    """The bytes of a resumable upload do not begin where those that have arrived end."""


class NoSnapshotError(
    ConflictError,
    code="no-snapshot",
    title="The scene has no model yet",
    retryable=True,
    usual_hint="Send images, run an update, and try again when it has made a snapshot.",
):
    """The scene has no model yet."""


class UnfinishedJobError(
    ConflictError,
    code="unfinished-job",
    title="A job has to end first",
    retryable=True,
    usual_hint="Try again when the job has ended.",
):
    """What is requested is possible once a job has ended."""


class StaleLeaseError(
    ConflictError,
    code="stale-lease",
    title="Another worker has leased the scene",
    rpc_status="ABORTED",
    usual_hint="Stop: the other worker goes on with the scene.",
):
    """Another worker has taken the lease: the operation must stop."""


class GoneError(
    ServiceError,
    code="gone",
    title="The resource has been deleted",
    status=410,
    rpc_status="NOT_FOUND",
    retryable=False,
    usual_hint="Use a new idempotency key.",
):
    """The resource that an idempotency key created has been deleted."""


class PreconditionFailedError(
    ServiceError,
    code="precondition-failed",
    title="The resource has changed",
    status=412,
    rpc_status="FAILED_PRECONDITION",
    retryable=False,
    usual_hint="Read the resource again, and decide whether the request still makes sense.",
):
    """The resource is no longer as the client has seen it."""


class ProtocolVersionError(
    PreconditionFailedError,
    code="unsupported-version",
    title="The version of the protocol is not supported",
    usual_hint="Name a version of the protocol that the service supports.",
):
    """The request is of another version of the protocol, or does not name it."""


class PayloadTooLargeError(
    ServiceError,
    code="payload-too-large",
    title="The body is too large",
    status=413,
    rpc_status="RESOURCE_EXHAUSTED",
    retryable=False,
    usual_hint="Send less: GET /v1/capabilities shows the limits.",
):
    """The body is larger than the limit."""


class UnsupportedMediaTypeError(
    ServiceError,
    code="unsupported-media-type",
    title="The body's type is not supported",
    status=415,
    rpc_status="INVALID_ARGUMENT",
    retryable=False,
    usual_hint="GET /openapi.json lists the types that the route accepts.",
):
    """The route does not accept this type of body."""


class RangeError(
    ServiceError,
    code="range-not-satisfiable",
    title="The range is not satisfiable",
    status=416,
    rpc_status="OUT_OF_RANGE",
    retryable=False,
    usual_hint="Ask for a range within these bytes, or for the whole artifact.",
):
    """The range lies outside of the artifact."""

    def __init__(self, size_bytes: int) -> None:
        super().__init__(f"The range lies outside of the {size_bytes} bytes.")
        self.size_bytes = size_bytes


class InvalidRequestError(
    ServiceError,
    code="invalid-request",
    title="The request is not valid",
    status=422,
    rpc_status="INVALID_ARGUMENT",
    retryable=False,
    usual_hint="GET /openapi.json and the protos describe the request.",
):
    """The request can be parsed but is not valid."""


class DigestMismatchError(
    InvalidRequestError,
    code="digest-mismatch",
    title="The bytes do not have the declared digest",
    retryable=True,
    usual_hint="Send the image again, or declare the digest of its bytes.",
):
    """The bytes do not have the declared digest: damaged in transit, or the wrong file."""


class LockedError(
    ServiceError,
    code="locked",
    title="Another request uses the resource",
    status=423,
    rpc_status="ABORTED",
    usual_hint="Try again soon.",
):
    """Another request sends the same upload."""


class ChecksumMismatchError(
    ServiceError,
    code="checksum-mismatch",
    title="The bytes do not have the declared checksum",
    status=460,
    rpc_status="DATA_LOSS",
    usual_hint="Send the same bytes again.",
):
    """The bytes of one request of an upload were damaged in transit; none of them is kept."""


class KeyReusedError(
    InvalidRequestError,
    code="idempotency-key-reused",
    title="The idempotency key belongs to another request",
    usual_hint="Use a new idempotency key for every new request.",
):
    """An idempotency key was used with another request before."""


class LimitExceededError(
    ServiceError,
    code="limit-exceeded",
    title="A limit is reached",
    status=429,
    rpc_status="RESOURCE_EXHAUSTED",
    usual_hint="Wait for those that are in progress, and send fewer at once.",
):
    """The tenant has reached a limit; ``retry_after_s`` is the time until a retry can succeed."""

    def __init__(self, message: str, *, hint: str = "", retry_after_s: int = 5) -> None:
        super().__init__(message, hint=hint, retry_after_s=retry_after_s)


class UnavailableError(
    ServiceError,
    code="unavailable",
    title="The service is not available now",
    status=503,
    rpc_status="UNAVAILABLE",
    usual_hint="Try again soon; fvs doctor shows the operator what is wrong.",
):
    """No worker, queue or database is available now."""


class StorageUnavailableError(UnavailableError):
    """The database or the object store cannot be reached or refuses the service; nothing is lost."""


class StorageRefusedError(StorageUnavailableError):
    """The object store refuses the service's credentials or clock, or its bucket does not exist."""


class IncompatibleDatabaseError(
    ServiceError,
    code="incompatible-database",
    title="The database has another version",
    status=500,
    retryable=False,
    usual_hint="Run a version of fvs that fits the database.",
):
    """The schema of the database belongs to another version of the service."""


class DeadlineError(
    ServiceError,
    code="deadline-exceeded",
    title="The answer takes longer than the client waits",
    status=504,
    rpc_status="DEADLINE_EXCEEDED",
    usual_hint="Try again later, wait longer, or ask for less in one request.",
):
    """The time that the client waits for the answer is over; what was computed for it has stopped."""


class ClientGoneError(
    ServiceError,
    code="client-gone",
    title="The client has closed the connection",
    status=499,
    rpc_status="CANCELLED",
    usual_hint="Try again, and keep the connection open until the response has arrived.",
):
    """The client closed the connection before the answer; the error is only logged and counted."""


class OutOfSpaceError(
    ServiceError,
    code="out-of-space",
    title="The disk is full",
    status=507,
    rpc_status="RESOURCE_EXHAUSTED",
    usual_hint="Free some space on the service's disk, then try again.",
):
    """The disk is full."""


def deadline_passed(timeout_s: float) -> DeadlineError:
    """The error for a request that could not be answered within ``timeout_s``."""
    return DeadlineError(
        f"There was no answer within {timeout_s:g} s.",
        hint="Try again later, with fewer candidates, or wait longer: raise X-Timeout-S, or over gRPC the "
        "deadline.",
    )


def stopping() -> UnavailableError:
    """The error for a request that ends because the service stops."""
    return UnavailableError("The service is stopping.", hint="Send the request again.", retry_after_s=5)
