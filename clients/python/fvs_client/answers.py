"""Parse the service's answers: models from 2xx, typed errors from the rest."""

import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TypeVar

import httpx2
import pydantic

from fvs_client.errors import ApiError, UnexpectedAnswerError, error_of
from fvs_client.models.missions import MissionFile
from fvs_schema.base import Model
from fvs_schema.events import Event
from fvs_schema.mistakes import described
from fvs_schema.problems import Problem
from fvs_schema.words import NEWER

M = TypeVar("M", bound=Model)
_REASONS = pydantic.TypeAdapter(tuple[str, ...])


def parse(kind: type[M], content: bytes, session: object = None) -> M:
    """Parse an answer; resources (a scene, a job, …) in it keep ``session`` for their own requests.

    Raises ``UnexpectedAnswerError``.
    """
    try:
        return kind.model_validate_json(content, extra="ignore", context={"session": session, NEWER: True})
    except pydantic.ValidationError as error:
        raise UnexpectedAnswerError(
            f"The answer does not fit {kind.__name__.lstrip('_')}: {_mistakes(error, content)}",
            hint="Check the URL, and that the service and this client have versions that fit.",
        ) from None


def _mistakes(error: pydantic.ValidationError, content: str | bytes) -> str:
    try:
        given = json.loads(content)
    except ValueError:
        return "It is no JSON."
    return described(error, given)


def refusal(response: httpx2.Response, request_id: str) -> ApiError:
    """The error for a response of 400 or more whose content has been read."""
    try:
        problem = Problem.model_validate_json(response.content)
    except pydantic.ValidationError:  # a proxy's page, or another program
        problem = Problem(
            status=response.status_code,
            code="",
            detail=f"The answer is {response.status_code}, and not from an fvs service.",
            hint="Check the URL, and whether a proxy answers in place of the service.",
            retryable=response.status_code in (408, 429, 502, 503, 504),
            request_id=response.headers.get("x-request-id", ""),
        )
    error = error_of(problem, _retry_after_s(response.headers))
    error.request_id = error.request_id or request_id
    return error


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


def event_number(message: httpx2.ServerSentEvent, default: int | None) -> int | None:
    """The event number after which to resume a stream, from ``message``; ``default`` when it has none.

    A stream begins with a message that has a number and no event.
    """
    return int(message.id) if message.id.isascii() and message.id.isdigit() else default


def parse_event(message: httpx2.ServerSentEvent) -> Event:
    """Parse an event of a scene; raises ``UnexpectedAnswerError``."""
    try:
        return Event.model_validate_json(message.data, context={NEWER: True})
    except pydantic.ValidationError as error:
        raise UnexpectedAnswerError(f"An event cannot be read: {_mistakes(error, message.data)}") from None


def mission_file(response: httpx2.Response) -> MissionFile:
    """The file in a response that has been read; raises ``UnexpectedAnswerError``."""
    found = re.fullmatch(
        r'attachment; filename="([^"/\\]+)"', response.headers.get("content-disposition", "")
    )
    if found is None:
        raise UnexpectedAnswerError("The answer is no file.", hint="Check the URL.")
    headers = response.headers
    left_out = headers.get("left-out", "")
    length_m, duration_s = headers.get("mission-length-m"), headers.get("mission-duration-s")
    try:
        return MissionFile(
            name=found[1],
            media_type=headers.get("content-type", ""),
            content=response.content,
            parts=int(headers.get("mission-parts", "1")),
            views=int(headers.get("mission-views", "0")),
            length_m=None if length_m is None else float(length_m),
            duration_s=None if duration_s is None else float(duration_s),
            left_out=tuple(left_out.split(",")) if left_out else (),
            reasons=_REASONS.validate_json(headers.get("left-out-reasons", "[]")),
        )
    except ValueError as error:
        raise UnexpectedAnswerError(f"The answer's headers cannot be read: {error}") from None
