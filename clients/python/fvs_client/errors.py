"""Errors of the client: distinguish them by class or ``code``, show ``str(error)`` and ``hint``."""

from collections.abc import Mapping, Sequence

from fvs_client.models.resources import JobData
from fvs_schema.error_codes import ErrorCode, FieldError
from fvs_schema.problems import Problem


class FvsError(Exception):
    """Base of all errors.

    ``code``: what kind of failure it is; ``retryable``: the same call can succeed later; ``hint``: what to do
    about it.
    """

    code: ErrorCode

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

    code = ErrorCode.CONNECTION_FAILED

    def __init__(self, message: str, *, hint: str = "", request_id: str | None = None) -> None:
        super().__init__(message, hint=hint, retryable=True, request_id=request_id)


class AnswerTimeoutError(ConnectionFailedError):
    """The service did not answer in time."""

    code = ErrorCode.ANSWER_TIMEOUT


class UnexpectedAnswerError(FvsError):
    """The answer is not from an fvs service, or from a version that this client does not know."""

    code = ErrorCode.UNEXPECTED_ANSWER


class UnreadableFormatError(FvsError):
    """The service does not read files of this format; in an upload's report."""

    code = ErrorCode.UNREADABLE_FORMAT


class UnusedMaskError(FvsError):
    """The file is in a folder of masks, and the mask of no image; in an upload's report."""

    code = ErrorCode.UNUSED_MASK


class DamagedDownloadError(FvsError):
    """The downloaded bytes differ from those of the service."""

    code = ErrorCode.DAMAGED_DOWNLOAD


class ApiError(FvsError):
    """The service refused the request; ``problem`` is its problem document."""

    code = ErrorCode.UNEXPECTED_ANSWER  # of an answer without a code: not from an fvs service

    def __init__(self, problem: Problem, retry_after_s: float | None = None) -> None:
        super().__init__(
            problem.detail or problem.title,
            hint=problem.hint,
            retryable=problem.retryable,
            request_id=problem.request_id or None,
        )
        self.problem = problem
        if problem.code:
            self.code = ErrorCode.of(problem.code)
        self.status = problem.status
        self.errors: Sequence[FieldError] = tuple(
            FieldError(one.field, one.message) for one in problem.errors
        )
        self.retry_after_s = retry_after_s


class MalformedRequestError(ApiError):
    """The request cannot be parsed."""

    code = ErrorCode.MALFORMED_REQUEST


class UnauthenticatedError(ApiError):
    """The API key is missing, unknown, expired or revoked."""

    code = ErrorCode.UNAUTHENTICATED


class ForbiddenError(ApiError):
    """The API key does not permit the request."""

    code = ErrorCode.FORBIDDEN


class NotFoundError(ApiError):
    """The resource does not exist, or belongs to another tenant."""

    code = ErrorCode.NOT_FOUND


class ConflictError(ApiError):
    """The request conflicts with the state of the resource."""

    code = ErrorCode.CONFLICT


class NoSnapshotError(ConflictError):
    """The scene has no model yet."""

    code = ErrorCode.NO_SNAPSHOT


class GoneError(ApiError):
    """The resource that this idempotency key created has been deleted."""

    code = ErrorCode.GONE


class PreconditionFailedError(ApiError):
    """The resource is no longer as it was when it was fetched."""

    code = ErrorCode.PRECONDITION_FAILED


class PayloadTooLargeError(ApiError):
    """The body is larger than the limit."""

    code = ErrorCode.PAYLOAD_TOO_LARGE


class InvalidRequestError(ApiError):
    """The request is invalid; ``errors`` has the fields."""

    code = ErrorCode.INVALID_REQUEST


class DigestMismatchError(InvalidRequestError):
    """The received bytes do not have the digest that was sent with them."""

    code = ErrorCode.DIGEST_MISMATCH


class IdempotencyKeyReusedError(InvalidRequestError):
    """An idempotency key was used again for a different request."""

    code = ErrorCode.IDEMPOTENCY_KEY_REUSED


class LimitExceededError(ApiError):
    """A limit is reached; try again after ``retry_after_s``."""

    code = ErrorCode.LIMIT_EXCEEDED


class ServiceFailedError(ApiError):
    """The service failed; its log has the details by ``request_id``."""

    code = ErrorCode.INTERNAL


class UnavailableError(ServiceFailedError):
    """The service cannot answer now."""

    code = ErrorCode.UNAVAILABLE


class DeadlineExceededError(ServiceFailedError):
    """The answer would take longer than the client waits."""

    code = ErrorCode.DEADLINE_EXCEEDED


class OutOfSpaceError(ServiceFailedError):
    """The service has no disk space left."""

    code = ErrorCode.OUT_OF_SPACE


class JobError(FvsError):
    """A job did not succeed; ``job`` is its last known state."""

    code = ErrorCode.JOB_FAILED

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

    code = ErrorCode.JOB_CANCELED

    def __init__(self, job: JobData) -> None:
        super().__init__(f"The {job.kind.value} job {job.id} was canceled.", job, retryable=True)


class WaitTimeoutError(JobError):
    """The job has not ended in time; it continues."""

    code = ErrorCode.WAIT_TIMEOUT

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


_BY_CODE: Mapping[str, type[ApiError]] = {kind.code: kind for kind in _all_below(ApiError)}
_BY_STATUS: Mapping[int, type[ApiError]] = {
    400: MalformedRequestError,
    401: UnauthenticatedError,
    403: ForbiddenError,
    404: NotFoundError,
    409: ConflictError,
    410: GoneError,
    412: PreconditionFailedError,
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
