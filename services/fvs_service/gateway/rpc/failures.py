"""Errors over gRPC: ``google.rpc.Status`` with what a problem document has.

``ErrorInfo`` has the code (its ``reason`` is the code in capitals), the hint, whether the same request can
succeed later, and the request's id; ``RetryInfo`` when to try again; ``BadRequest`` what is invalid.
"""

import grpc
from google.rpc import code_pb2, error_details_pb2, status_pb2

from fvs_service.errors import ServiceError

DOMAIN = "fvs"
DETAILS = "grpc-status-details-bin"
_TEXT_BYTES = 1_000
"""Maximum length of a message or hint."""
_FIELDS_BYTES = 3_000
"""Maximum size of all invalid fields together: clients accept 8 kB of trailers."""


def code_of(error: ServiceError) -> grpc.StatusCode:
    """The gRPC status of an error."""
    return grpc.StatusCode[error.rpc_status]


def status_of(error: ServiceError, request_id: str) -> status_pb2.Status:
    """The status of a request that failed with ``error``, with its details."""
    status = status_pb2.Status(
        code=code_pb2.Code.Value(error.rpc_status), message=_short(error.message, _TEXT_BYTES)
    )
    about = {
        "code": error.code,
        "title": error.title,
        "hint": _short(error.hint, _TEXT_BYTES),
        "retryable": str(error.retryable).lower(),
        "request_id": request_id,
    }
    reason = error.code.upper().replace("-", "_")
    status.details.add().Pack(error_details_pb2.ErrorInfo(reason=reason, domain=DOMAIN, metadata=about))
    if error.retry_after_s is not None:
        again = error_details_pb2.RetryInfo()
        again.retry_delay.seconds = error.retry_after_s
        status.details.add().Pack(again)
    if error.errors:
        status.details.add().Pack(_violations(error))
    return status


def _violations(error: ServiceError) -> error_details_pb2.BadRequest:
    found = error_details_pb2.BadRequest()
    for item in error.errors:
        found.field_violations.add(field=item.field, description=item.message)
        if found.ByteSize() > _FIELDS_BYTES:
            found.field_violations.pop()
            break
    return found


def _short(text: str, most: int) -> str:
    content = text.encode()
    return text if len(content) <= most else content[:most].decode(errors="ignore") + "…"
