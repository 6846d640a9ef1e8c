"""Every failure that a caller can meet. Decide by class, or by ``code``; show ``str(error)`` and ``hint``."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from fvs_client.models.base import Answer
from fvs_client.models.jobs import JobData


class FieldError(Answer):
    """One part of the input that is wrong: where (``candidates.3.id``) and why."""

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
    """Base of all. ``retryable``: whether the same call can succeed later; ``hint``: what to do about it."""

    def __init__(
        self, message: str, *, hint: str = "", retryable: bool = False, request_id: str | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.retryable = retryable
        self.request_id = request_id
        """What the service's log calls the request; None when there was none."""


class ConnectionFailedError(FvsError):
    """The service cannot be reached, or the connection broke."""

    def __init__(self, message: str, *, hint: str = "", request_id: str | None = None) -> None:
        super().__init__(message, hint=hint, retryable=True, request_id=request_id)


class AnswerTimeoutError(ConnectionFailedError):
    """The service is there and did not answer in time."""


class UnexpectedAnswerError(FvsError):
    """Something answered that is not the service, or not a version that this client understands."""


class DamagedDownloadError(FvsError):
    """What was downloaded is not what the service has."""


class ApiError(FvsError):
    """The service refused; ``problem`` has all it said."""

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
    """The request could not be read at all."""

    code = "malformed-request"


class UnauthenticatedError(ApiError):
    """No API key, or one that is not known, expired or revoked."""

    code = "unauthenticated"


class ForbiddenError(ApiError):
    """The API key is good, but not for this."""

    code = "forbidden"


class NotFoundError(ApiError):
    """It does not exist, or belongs to somebody else."""

    code = "not-found"


class ConflictError(ApiError):
    """The request contradicts the state of what it is about."""

    code = "conflict"


class NoSnapshotError(ConflictError):
    """The scene has no model yet."""

    code = "no-snapshot"


class PayloadTooLargeError(ApiError):
    """The body is larger than the limit."""

    code = "payload-too-large"


class InvalidRequestError(ApiError):
    """The request could be read and cannot be used; ``errors`` says which part of it."""

    code = "invalid-request"


class DigestMismatchError(InvalidRequestError):
    """The bytes did not arrive as they were when they were read."""

    code = "digest-mismatch"


class IdempotencyKeyReusedError(InvalidRequestError):
    """An idempotency key came back with another request."""

    code = "idempotency-key-reused"


class LimitExceededError(ApiError):
    """A limit is reached; ``retry_after_s`` says when to ask again."""

    code = "limit-exceeded"


class ServiceFailedError(ApiError):
    """The service failed; its log has the details under ``request_id``."""

    code = "internal"


class UnavailableError(ServiceFailedError):
    """The service cannot answer now."""

    code = "unavailable"


class OutOfSpaceError(ServiceFailedError):
    """The service has no room left."""

    code = "out-of-space"


class JobError(FvsError):
    """A job did not succeed; ``job`` says how far it came."""

    def __init__(self, message: str, job: JobData, *, hint: str = "", retryable: bool = False) -> None:
        super().__init__(message, hint=hint, retryable=retryable)
        self.job = job


class JobFailedError(JobError):
    """The job failed; ``job.error`` says why."""

    def __init__(self, job: JobData) -> None:
        why = job.error
        super().__init__(
            f"The {job.kind.value} job {job.id} failed: {why.message if why else 'it does not say why.'}",
            job,
            hint=why.hint if why else "",
            retryable=why.retryable if why else False,
        )


class JobCanceledError(JobError):
    """Somebody canceled the job."""

    def __init__(self, job: JobData) -> None:
        super().__init__(f"The {job.kind.value} job {job.id} was canceled.", job, retryable=True)


class WaitTimeoutError(JobError):
    """The job had not ended in time; it goes on."""

    def __init__(self, job: JobData, timeout_s: float) -> None:
        super().__init__(
            f"The {job.kind.value} job {job.id} has not ended within {timeout_s:g} s; "
            f"it is {job.state.value}, at {job.progress:.0%}.",
            job,
            hint="It goes on; wait again, or cancel it.",
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
    413: PayloadTooLargeError,
    422: InvalidRequestError,
    429: LimitExceededError,
    503: UnavailableError,
    507: OutOfSpaceError,
}


def error_of(problem: Problem, retry_after_s: float | None = None) -> ApiError:
    """The error that ``problem`` is: by its code, or by its status when a newer service says a new code."""
    kind = _BY_CODE.get(problem.code) or _BY_STATUS.get(problem.status)
    if kind is None:
        kind = ServiceFailedError if problem.status >= 500 else ApiError
    return kind(problem, retry_after_s)
