"""One request and its answer: sent again when that may help, and read as what it is."""

import time
import uuid
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TypeVar

import pydantic

from fvs_client.effects import Close, Open, OpenReply, Operation, Reply, Request, Sleep, read, send
from fvs_client.errors import FvsError, Problem, UnexpectedAnswerError, error_of
from fvs_client.retries import Retries

M = TypeVar("M", bound=pydantic.BaseModel)

REQUEST_ID = "X-Request-Id"


def exchange(request: Request, retries: Retries) -> Operation[Reply]:
    """Send ``request`` until it is answered well; raises the last error."""
    request = identified(request)
    began, attempt = time.monotonic(), 0
    while True:
        attempt += 1
        try:
            reply = yield from send(request)
            if reply.status < 400:
                return reply
            raise refusal(reply)
        except FvsError as error:
            error.request_id = error.request_id or request.headers[REQUEST_ID]
            pause = retries.pause_s(error, attempt, time.monotonic() - began)
            if pause is None or not request.repeatable:
                raise
        yield Sleep(pause)


def opened(request: Request) -> Operation[OpenReply]:
    """Send ``request`` once and leave its content to be read; raises what a refusal is."""
    request = identified(request)
    reply: OpenReply = yield Open(request)
    if reply.status >= 400:
        content = yield from _whole(reply)
        raise refusal(Reply(reply.status, reply.headers, content))
    return reply


def identified(request: Request) -> Request:
    """``request`` with an id, which the service's log has too, also when no answer arrives."""
    return replace(request, headers={REQUEST_ID: f"req_{uuid.uuid4().hex}", **request.headers})


def parse(kind: type[M], content: bytes, session: object) -> M:
    """What the service answered; what can be asked more (a scene, a job, …) asks ``session``."""
    try:
        return kind.model_validate_json(content, context={"session": session})
    except pydantic.ValidationError as error:
        raise UnexpectedAnswerError(
            f"The answer is not what this client expects of {kind.__name__}: {error.errors()[0]['msg']}",
            hint="Is the URL that of an fvs service, of a version that this client knows?",
        ) from error


def refusal(reply: Reply) -> FvsError:
    """The error that a reply of 400 or more is."""
    try:
        problem = Problem.model_validate_json(reply.content)
    except pydantic.ValidationError:  # a proxy's page, or another program altogether
        problem = Problem(
            status=reply.status,
            code="",
            detail=f"The answer is {reply.status}, and not from an fvs service.",
            hint="Is the URL right? Is there a proxy in between?",
            retryable=reply.status in (408, 429, 502, 503, 504),
            request_id=reply.headers.get("x-request-id", ""),
        )
    return error_of(problem, _retry_after_s(reply.headers))


def _whole(reply: OpenReply) -> Operation[bytes]:
    parts = []
    while (chunk := (yield from read(reply.stream))) is not None:
        parts.append(chunk)
    yield Close(reply.stream)
    return b"".join(parts)


def _retry_after_s(headers: Mapping[str, str]) -> float | None:
    """``Retry-After`` (RFC 9110, section 10.2.3): seconds, or a date."""
    value = headers.get("retry-after", "").strip()
    if value.isascii() and value.isdigit():
        return float(value)
    try:
        moment = parsedate_to_datetime(value)
    except ValueError:
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())
