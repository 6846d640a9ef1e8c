"""The codes of errors, and the invalid fields that errors name. Imports nothing heavy."""

from dataclasses import dataclass

from fvs_schema.words import Word


@dataclass(frozen=True)
class FieldError:
    """An invalid part of the input: its location (``candidates.3.id``) and the reason."""

    field: str
    message: str


class ErrorCode(Word):
    """What kind of failure an error is. Codes are strings: ``error.code == "not-found"``."""

    # Of the service.
    CHECKSUM_MISMATCH = "checksum-mismatch"
    CLIENT_GONE = "client-gone"
    CONFLICT = "conflict"
    DEADLINE_EXCEEDED = "deadline-exceeded"
    DIGEST_MISMATCH = "digest-mismatch"
    FORBIDDEN = "forbidden"
    FOREIGN_ORIGIN = "foreign-origin"
    GONE = "gone"
    IDEMPOTENCY_KEY_REUSED = "idempotency-key-reused"
    INCOMPATIBLE_DATABASE = "incompatible-database"
    INTERNAL = "internal"
    INVALID_REQUEST = "invalid-request"
    LIMIT_EXCEEDED = "limit-exceeded"
    LOCKED = "locked"
    MALFORMED_REQUEST = "malformed-request"
    METHOD_NOT_ALLOWED = "method-not-allowed"
    NO_SNAPSHOT = "no-snapshot"
    NOT_FOUND = "not-found"
    OFFSET_MISMATCH = "offset-mismatch"
    OUT_OF_SPACE = "out-of-space"
    PAYLOAD_TOO_LARGE = "payload-too-large"
    PRECONDITION_FAILED = "precondition-failed"
    RANGE_NOT_SATISFIABLE = "range-not-satisfiable"
    REQUEST_TIMEOUT = "request-timeout"
    STALE_LEASE = "stale-lease"
    UNAUTHENTICATED = "unauthenticated"
    UNAVAILABLE = "unavailable"
    UNFINISHED_JOB = "unfinished-job"
    UNKNOWN_HOST = "unknown-host"
    UNSUPPORTED_MEDIA_TYPE = "unsupported-media-type"
    UNSUPPORTED_VERSION = "unsupported-version"

    # Of this client.
    ANSWER_TIMEOUT = "answer-timeout"
    CONNECTION_FAILED = "connection-failed"
    DAMAGED_DOWNLOAD = "damaged-download"
    JOB_CANCELED = "job-canceled"
    JOB_FAILED = "job-failed"
    UNEXPECTED_ANSWER = "unexpected-answer"
    UNREADABLE_FORMAT = "unreadable-format"
    UNUSED_MASK = "unused-mask"
    USAGE = "usage"
    VEHICLE = "vehicle"
    WAIT_TIMEOUT = "wait-timeout"
