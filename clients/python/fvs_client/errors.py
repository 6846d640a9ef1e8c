"""Errors of the client: distinguish them by class or ``code``, show ``str(error)`` and ``hint``."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from fvs_client.models.base import Answer
from fvs_client.models.jobs import JobData


class FieldError(Answer):
    """An invalid part of the input: where (``candidates.3.id``) and why."""

    field: str
    message: str


class Problem(Answer):
    """The service's problem document (RFC 9457)."""

    title: str = ""
    status: int
    code: str
    detail: str = ""
    hint: str = ""
    retryable: bool = False
    request_id: str = ""
    errors: tuple[FieldError, ...] = ()


class FvsError(Exception):
    """Base of all errors. ``retryable``: the same call can succeed later; ``hint``: what to do about it."""

    def __init__(
        self, message: str, *, hint: str = "", retryable: bool = False, request_id: str | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.retryable = retryable
        self.request_id = request_id
        """Id of the request in the service's log; None when no request failed."""


class ConnectionFailedError(FvsError):
    """The service cannot be reached, or the connection broke."""

    def __init__(self, message: str, *, hint: str = "", request_id: str | None = None) -> None:
        super().__init__(message, hint=hint, retryable=True, request_id=request_id)


class AnswerTimeoutError(ConnectionFailedError):
    """The service did not answer in time."""


class UnexpectedAnswerError(FvsError):
    """The answer is not from an fvs service, or from a version that this client does not know."""


class DamagedDownloadError(FvsError):
    """The downloaded bytes differ from those of the service."""


class ApiError(FvsError):
    """The service refused the request; ``problem`` is its problem document."""

    code: ClassVar[str] = ""

    def __init__(self, problem: Problem, retry_after_s: float | None = None) -> None:
        super().__init__(
            problem.detail or problem.title,
            hint=problem.hint,
            retryable=problem.retryable,
            request_id=problem.request_id or None,
        )
        self.problem = problem
        self.status = problem.status
        self.errors: Sequence[FieldError] = problem.errors
        self.retry_after_s = retry_after_s


class MalformedRequestError(ApiError):
    """The request cannot be parsed."""

    code = "malformed-request"


class UnauthenticatedError(ApiError):
    """The API key is missing, unknown, expired or revoked."""

    code = "unauthenticated"


class ForbiddenError(ApiError):
    """The API key does not permit the request."""

    code = "forbidden"


class NotFoundError(ApiError):
    """The resource does not exist, or belongs to another tenant."""

    code = "not-found"


class ConflictError(ApiError):
    """The request conflicts with the state of the resource."""

    code = "conflict"


class NoSnapshotError(ConflictError):
    """The scene has no model yet."""

    code = "no-snapshot"


class GoneError(ApiError):
    """The resource that this idempotency key created has been deleted."""

    code = "gone"


class PayloadTooLargeError(ApiError):
    """The body is larger than the limit."""

    code = "payload-too-large"


class InvalidRequestError(ApiError):
    """The request is invalid; ``errors`` has the fields."""

    code = "invalid-request"


class DigestMismatchError(InvalidRequestError):
    """The received bytes do not have the digest that was sent with them."""

    code = "digest-mismatch"


class IdempotencyKeyReusedError(InvalidRequestError):
    """An idempotency key was used again for a different request."""

    code = "idempotency-key-reused"


class LimitExceededError(ApiError):
    """A limit is reached; try again after ``retry_after_s``."""

    code = "limit-exceeded"


class ServiceFailedError(ApiError):
    """The service failed; its log has the details by ``request_id``."""

    code = "internal"


class UnavailableError(ServiceFailedError):
    """The service cannot answer now."""

    code = "unavailable"


class DeadlineExceededError(ServiceFailedError):
    """The answer would take longer than the client waits."""

    code = "deadline-exceeded"


class OutOfSpaceError(ServiceFailedError):
    """The service has no disk space left."""

    code = "out-of-space"


class UnimplementedError(ApiError):
    """The service lacks the method, because it is older than this client; only over gRPC."""

    code = "unimplemented"


class JobError(FvsError):
    """A job did not succeed; ``job`` is its last known state."""

    def __init__(self, message: str, job: JobData, *, hint: str = "", retryable: bool = False) -> None:
        super().__init__(message, hint=hint, retryable=retryable)
        self.job = job


class JobFailedError(JobError):
    """The job failed; ``job.error`` has the reason."""

    def __init__(self, job: JobData) -> None:
        why = job.error
        super().__init__(
            f"The {job.kind.value} job {job.id} failed: {why.message if why else 'no reason given.'}",
            job,
            hint=why.hint if why else "",
            retryable=why.retryable if why else False,
        )


class JobCanceledError(JobError):
    """The job was canceled."""

    def __init__(self, job: JobData) -> None:
        super().__init__(f"The {job.kind.value} job {job.id} was canceled.", job, retryable=True)


class WaitTimeoutError(JobError):
    """The job has not ended in time; it continues."""

    def __init__(self, job: JobData, timeout_s: float) -> None:
        super().__init__(
            f"The {job.kind.value} job {job.id} has not ended within {timeout_s:g} s; "
            f"it is {job.state.value}, at {job.progress:.0%}.",
            job,
            hint="The job continues: wait again, or cancel it.",
            retryable=True,
        )


def _all_below(kind: type[ApiError]) -> list[type[ApiError]]:
    return [kind, *(found for child in kind.__subclasses__() for found in _all_below(child))]


_BY_CODE: Mapping[str, type[ApiError]] = {kind.code: kind for kind in _all_below(ApiError) if kind.code}
_BY_STATUS: Mapping[int, type[ApiError]] = {
    400: MalformedRequestError,
    401: UnauthenticatedError,
    403: ForbiddenError,
    404: NotFoundError,
    409: ConflictError,
    410: GoneError,
    413: PayloadTooLargeError,
    422: InvalidRequestError,
    429: LimitExceededError,
    503: UnavailableError,
    507: OutOfSpaceError,
}


def error_of(problem: Problem, retry_after_s: float | None = None) -> ApiError:
    """The error for ``problem``: by code, or by status for an unknown code of a newer service."""
    kind = _BY_CODE.get(problem.code) or _BY_STATUS.get(problem.status)
    if kind is None:
        kind = ServiceFailedError if problem.status >= 500 else ApiError
    return kind(problem, retry_after_s)
