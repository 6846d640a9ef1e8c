"""What a call returns, in a form that does not show how it was called."""

import json
from dataclasses import dataclass, field
from typing import Any

import httpx2
from google.rpc import error_details_pb2, status_pb2

_LISTS_OR_NULL = frozenset({"aim", "along", "centre"})
"""Lists that cannot be empty, and are null in REST when they are absent."""


@dataclass(frozen=True)
class Outcome:
    """What a call returned: a document, or the error's code and what else is stable of it."""

    result: Any = None
    code: str = ""
    retryable: bool | None = None
    message: str = ""
    hint: str = field(default="", compare=False)
    """Not compared: it names REST's or gRPC's own means."""
    fields: tuple[str, ...] = ()
    retry_after: bool = False


def outcome_of_response(response: Any) -> Outcome:
    """What a response of REST says."""
    if response.status_code < 400:
        if response.content and response.headers.get("content-type") == "application/json":
            return Outcome(result=response.json())
        if response.headers.get("content-type", "").startswith("text/event-stream"):
            return Outcome(result=[json.loads(one.data) for one in httpx2.EventSource(response)])
        return Outcome(result=response.content or None)
    problem = response.json()
    return Outcome(
        code=problem["code"],
        retryable=problem["retryable"],
        message=problem["detail"],
        hint=problem["hint"],
        fields=tuple(item["field"] for item in problem["errors"]),
        retry_after="retry-after" in response.headers,
    )


def outcome_of_error(error: Any) -> Outcome:
    """What a status of gRPC says."""
    found = dict(error.trailing_metadata()).get("grpc-status-details-bin")
    assert found is not None, f"{error.code()} {error.details()}"
    status = status_pb2.Status.FromString(found)
    about, again, wrong = error_details_pb2.ErrorInfo(), False, ()
    for detail in status.details:
        if detail.Unpack(about):
            continue
        again = again or detail.Is(error_details_pb2.RetryInfo.DESCRIPTOR)
        violations = error_details_pb2.BadRequest()
        if detail.Unpack(violations):
            wrong = tuple(item.field for item in violations.field_violations)
    assert about.reason == about.metadata["code"].upper().replace("-", "_")
    return Outcome(
        code=about.metadata["code"],
        retryable=about.metadata["retryable"] == "true",
        message=status.message,
        hint=about.metadata["hint"],
        fields=wrong,
        retry_after=again,
    )


def document_of(message: Any) -> Any:
    """A message as REST's document, read independently of the service's conversion."""
    names = [described.name for described in message.DESCRIPTOR.fields]
    oneofs = message.DESCRIPTOR.oneofs_by_name
    if message.DESCRIPTOR.full_name == "google.protobuf.Timestamp":
        return message.ToJsonString()
    if names == ["items"]:
        (items,) = message.DESCRIPTOR.fields
        return [_one(items, item) for item in message.items]
    for union in ("kind", "pose"):
        if union in oneofs:
            member = message.WhichOneof(union)
            kind = {"kind": member.replace("_", "-")} if union == "kind" else {}
            return {**kind, **document_of(getattr(message, member))}
    return {described.name: _field(message, described) for described in message.DESCRIPTOR.fields}


def _field(message: Any, described: Any) -> Any:
    value = getattr(message, described.name)
    if described.message_type is not None and described.message_type.GetOptions().map_entry:
        return dict(value)
    if described.is_repeated:
        found = [_one(described, item) for item in value]
        return found or (None if described.name in _LISTS_OR_NULL else [])
    if described.has_presence and not message.HasField(described.name):
        return None
    return _one(described, value)


def _one(described: Any, value: Any) -> Any:
    if described.enum_type is not None:
        return rest_word(described.enum_type, value) if value else None
    return document_of(value) if described.message_type is not None else value


def rest_word(enum: Any, number: int) -> str:
    """REST's word for a value of an enum: what follows the words that all of its values begin with."""
    words = [value.name for value in enum.values]
    common = next(name for name in words if name.endswith("_UNSPECIFIED")).removesuffix("UNSPECIFIED")
    separator = "." if enum.name == "EventKind" else "-"
    return enum.values_by_number[number].name.removeprefix(common).lower().replace("_", separator)
