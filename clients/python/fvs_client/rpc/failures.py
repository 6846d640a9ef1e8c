"""Failed calls as their HTTP equivalents: the service's problem documents, and errors of the connection."""

import json
from typing import Any

import grpc
import httpx2
from google.protobuf.message import DecodeError
from google.rpc.error_details_pb2 import BadRequest, ErrorInfo, RetryInfo
from google.rpc.status_pb2 import Status

_DETAILS = "grpc-status-details-bin"
_DOMAIN = "fvs"
_BY_CODE = {
    "malformed-request": 400,
    "method-not-allowed": 405,
    "request-timeout": 408,
    "gone": 410,
    "precondition-failed": 412,
    "payload-too-large": 413,
    "unsupported-media-type": 415,
    "unknown-host": 421,
    "out-of-space": 507,
}
"""The HTTP status of problems whose gRPC status stands for several."""
_BY_STATUS = {
    grpc.StatusCode.INVALID_ARGUMENT: 422,
    grpc.StatusCode.UNAUTHENTICATED: 401,
    grpc.StatusCode.PERMISSION_DENIED: 403,
    grpc.StatusCode.NOT_FOUND: 404,
    grpc.StatusCode.FAILED_PRECONDITION: 409,
    grpc.StatusCode.ABORTED: 409,
    grpc.StatusCode.OUT_OF_RANGE: 416,
    grpc.StatusCode.RESOURCE_EXHAUSTED: 429,
    grpc.StatusCode.UNIMPLEMENTED: 501,
    grpc.StatusCode.UNAVAILABLE: 503,
    grpc.StatusCode.DEADLINE_EXCEEDED: 504,
}
_CUT = ("socket closed", "connection reset")
_NOT_CONNECTED = ("connect to all addresses", "connection refused", "resolution", "handshake", "ssl")
_NOT_TRUSTED = ("ssl", "certificate", "handshake")
_TOO_LARGE = "message larger than max"
_TOO_MANY = "concurrent rpc limit exceeded"
_OF_CLIENT = "CLIENT:"
"""gRPC reports which side's limit was exceeded."""
_OF_PROXY = "http2 header"
"""In the text of a status that gRPC makes of an answer that is only HTTP."""


def response_for(error: grpc.RpcError, request: httpx2.Request) -> httpx2.Response:
    """The response of a service that refused ``request``.

    Raises the ``httpx2.TransportError`` for a call that did not reach the service, or broke; and
    ``httpx2.DecodingError`` for an answer that is larger than the client accepts.
    """
    status = _status_of(error)
    if status is not None:
        return _refusal(error, status)
    code, text = error.code(), error.details() or ""
    if code is grpc.StatusCode.DEADLINE_EXCEEDED:
        if (within := request.headers.get("X-Timeout-S")) is not None:
            return _deadline_passed(within)
        raise httpx2.ReadTimeout(text, request=request)
    if code is grpc.StatusCode.UNAVAILABLE:
        raise _unavailable(text, request)
    if code is grpc.StatusCode.RESOURCE_EXHAUSTED and _TOO_LARGE in text:
        if _OF_CLIENT in text:
            raise httpx2.DecodingError(f"it is too large: {text}", request=request)
        return _too_large()
    if code is grpc.StatusCode.RESOURCE_EXHAUSTED and _TOO_MANY in text.lower():
        return _too_many_calls()
    if code is grpc.StatusCode.UNIMPLEMENTED and _OF_PROXY not in text.lower():
        return _unimplemented(request)
    if code in _BY_STATUS:
        raise httpx2.RemoteProtocolError(f"{code.name}, and not from an fvs service: {text}", request=request)
    raise httpx2.ReadError(text, request=request)


def invalid(message: str) -> httpx2.Response:
    """The response to a request that the contract cannot express."""
    problem = {"title": "The request is not valid", "code": "invalid-request", "detail": f"{message}."}
    return _problem(422, {**problem, "hint": "proto/fvs/v1 describes the request.", "retryable": False})


def _unavailable(text: str, request: httpx2.Request) -> httpx2.TransportError:
    lower = text.lower()
    if "http1" in lower or "http/1" in lower:
        return httpx2.RemoteProtocolError(
            "a server without gRPC answers; is the port right?", request=request
        )
    if any(words in lower for words in _CUT) or not any(words in lower for words in _NOT_CONNECTED):
        return httpx2.ReadError(text, request=request)
    mark = "[SSL] " if any(words in lower for words in _NOT_TRUSTED) else ""
    return httpx2.ConnectError(f"{mark}{text}", request=request)


def _status_of(error: grpc.RpcError) -> Status | None:
    """The details of an error; None when it is not the service's."""
    for key, value in error.trailing_metadata() or ():
        if key == _DETAILS:
            try:
                return Status.FromString(value)
            except DecodeError:
                return None
    return None


def _refusal(error: grpc.RpcError, status: Status) -> httpx2.Response:
    about, again, fields = ErrorInfo(), RetryInfo(), BadRequest()
    for detail in status.details:
        for message in (about, again, fields):
            detail.Unpack(message)
    code = about.metadata.get("code", "") if about.domain == _DOMAIN else ""
    problem = {
        "title": about.metadata.get("title", ""),
        "code": code,
        "detail": status.message,
        "hint": about.metadata.get("hint", ""),
        "retryable": about.metadata.get("retryable") == "true",
        "request_id": about.metadata.get("request_id", ""),
        "errors": [{"field": item.field, "message": item.description} for item in fields.field_violations],
    }
    headers = {"Retry-After": str(again.retry_delay.seconds)} if again.HasField("retry_delay") else {}
    return _problem(_BY_CODE.get(code) or _BY_STATUS.get(error.code(), 500), problem, headers)


def _deadline_passed(within: str) -> httpx2.Response:
    problem = {
        "title": "The answer takes longer than the client waits",
        "code": "deadline-exceeded",
        "detail": f"There was no answer within {within} s.",
        "hint": "Try again later, with fewer candidates, or wait longer: raise timeout_s.",
        "retryable": True,
    }
    return _problem(504, problem)


def _too_large() -> httpx2.Response:
    """The refusal of a message that gRPC itself rejects before the service sees it."""
    problem = {
        "title": "The body is too large",
        "code": "payload-too-large",
        "detail": "The request has more bytes than the service accepts.",
        "hint": "Split it into several calls; limits.json_bytes of the capabilities is the limit.",
        "retryable": False,
    }
    return _problem(413, problem)


def _too_many_calls() -> httpx2.Response:
    """The refusal of a call that gRPC itself rejects because the service has too many."""
    problem = {
        "title": "A limit is reached",
        "code": "limit-exceeded",
        "detail": "The service has as many open calls as it allows.",
        "hint": "Try again soon.",
        "retryable": True,
    }
    return _problem(429, problem, {"Retry-After": "1"})


def _unimplemented(request: httpx2.Request) -> httpx2.Response:
    problem = {
        "title": "The service lacks the method",
        "code": "unimplemented",
        "detail": f"The service has no method for {request.method} {request.url.path}.",
        "hint": "This client is newer: upgrade the service. Or another gRPC server answers: check the URL.",
        "retryable": False,
    }
    return _problem(501, problem)


def _problem(status: int, problem: dict[str, Any], headers: dict[str, str] | None = None) -> httpx2.Response:
    content = json.dumps({**problem, "status": status}).encode()
    return httpx2.Response(status, headers=headers, content=content)
