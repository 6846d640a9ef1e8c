"""Conversion between models and messages of ``fvs.v1``, derived from the descriptors.

A message has its model's fields under their names. What protobuf cannot express follows a few rules:

* ``None`` is an absent field, and absent fields of requests have the defaults of the model;
* an enum value is the model's in capitals after the enum's name: ``JOB_STATE_QUEUED`` is "queued"; zero is
  none;
* a message whose only field is ``items`` is a list, which can be present and empty;
* a message with a ``oneof`` ``kind`` is a union whose members have a ``kind``; one with a ``oneof``
  ``pose`` is a union of members that differ by their fields;
* timestamps are ``google.protobuf.Timestamp``, any object is a ``Struct``, numbers or texts by name a map.
"""

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass
from datetime import UTC
from functools import cache
from typing import Any, TypeVar

from google.protobuf.descriptor import Descriptor, EnumDescriptor, FieldDescriptor
from google.protobuf.message import DecodeError, Message
from pydantic import ValidationError

from fvs_schema.base import Model
from fvs_schema.error_codes import FieldError
from fvs_schema.mistakes import sentence
from fvs_schema.service import Limits
from fvs_service.errors import InvalidRequestError, MalformedRequestError
from fvs_service.gateway.validation import invalid_body

ModelT = TypeVar("ModelT", bound=Model)
MessageT = TypeVar("MessageT", bound=Message)

_HINT = "proto/fvs/v1 describes the request; GET /openapi.json has the ranges."
_NEWER = "The client may be newer than the service, which refuses what it does not know."
_ITEMS_NAMED = 1_000
"""Items of a list in which an unknown field is looked for to name it."""
_TAG_BYTES = 5
_TIMESTAMP, _STRUCT = "google.protobuf.Timestamp", "google.protobuf.Struct"


def parse(kind: type[MessageT], content: bytes) -> MessageT:
    """The message in ``content``; raises ``MalformedRequestError``, and for unknown fields as ``read``."""
    try:
        message: MessageT = kind.FromString(content)
    except DecodeError:
        raise MalformedRequestError(
            f"The request is not a {kind.DESCRIPTOR.full_name}.", hint=_HINT
        ) from None
    _require_known_fields(message, content)
    return message


def read(kind: type[ModelT], message: Message, limits: Limits | None = None) -> ModelT:
    """The message as a ``kind``, validated with ``limits``; raises ``InvalidRequestError``."""
    return _validated(kind, _document(message, ""), limits)


def pick(kind: type[ModelT], message: Message) -> ModelT:
    """The fields of a message that ``kind`` has; raises ``InvalidRequestError``."""
    return _validated(kind, _fields_of(message, "", kind.model_fields), None)


def _validated(kind: type[ModelT], document: Any, limits: Limits | None) -> ModelT:
    try:
        return kind.model_validate(document, context={"limits": limits})
    except ValidationError as error:
        invalid = invalid_body(error, document, _HINT)
    raise invalid  # outside: its traceback would keep the document


def write(model: Model, kind: type[MessageT]) -> MessageT:
    """The model as a message."""
    message: MessageT = kind(**arguments(kind.DESCRIPTOR, model.model_dump()))
    return message


@dataclass(frozen=True)
class _Field:
    """Properties of a field's descriptor, cached because the descriptor's own are slow."""

    repeated: bool
    message: Descriptor | None
    timestamp: bool
    enum: EnumDescriptor | None
    words: Mapping[int, str]
    numbers: Mapping[str, int]


@cache
def _fields(descriptor: Descriptor) -> Mapping[str, _Field]:
    found = {}
    for field in descriptor.fields:
        message = field.message_type
        words = {} if field.enum_type is None else _words(field.enum_type)
        found[field.name] = _Field(
            repeated=field.is_repeated and not _is_map(message),
            message=None if message is None or _has_own_form(message) else message,
            timestamp=message is not None and message.full_name == _TIMESTAMP,
            enum=field.enum_type,
            words=words,
            numbers={word: number for number, word in words.items()},
        )
    return found


def _document(message: Message, path: str) -> Any:
    """The document that pydantic validates: objects, lists and values under the names of the model."""
    descriptor = message.DESCRIPTOR
    union = _union(descriptor)
    if union is not None:
        return _member(message, union, path)
    if _is_list(descriptor):
        if _fields(descriptor)["items"].message is None:
            return list(message.items)
        return [_document(item, f"{path}.{place}") for place, item in enumerate(message.items)]
    return _fields_of(message, path, None)


def _fields_of(message: Message, path: str, wanted: Container[str] | None) -> dict[str, Any]:
    fields, found = _fields(message.DESCRIPTOR), {}
    for described, value in message.ListFields():
        name = described.name
        if wanted is not None and name not in wanted:
            continue
        field, inner = fields[name], f"{path}.{name}" if path else name
        if field.message is None and field.enum is None and not field.timestamp:
            found[name] = list(value) if field.repeated else value
        elif field.repeated:
            found[name] = [_value(field, item, f"{inner}.{place}") for place, item in enumerate(value)]
        else:
            found[name] = _value(field, value, inner)
    return found


def _member(message: Message, union: str, path: str) -> dict[str, Any]:
    name = message.WhichOneof(union)
    if name is None:
        raise _invalid(path or union, "it is empty: set one of its members")
    found: dict[str, Any] = _document(getattr(message, name), path)
    return {"kind": name.replace("_", "-"), **found} if union == "kind" else found


def _value(field: _Field, value: Any, path: str) -> Any:
    if field.enum is not None:
        if value not in field.words:
            raise _invalid(path, f"{field.enum.name} has no value {value} here", _NEWER)
        return field.words[value]
    if not field.timestamp:
        return _document(value, path)
    try:
        return value.ToDatetime(UTC)
    except (ValueError, OverflowError):
        raise _invalid(path, "it is not a time") from None


def arguments(descriptor: Descriptor, document: Any) -> Mapping[str, Any]:
    """The arguments of the constructor of a message, which makes the messages inside too."""
    if _is_list(descriptor):
        return {"items": [_argument(_fields(descriptor)["items"], item) for item in document]}
    union = _union(descriptor)
    if union is not None:
        name = _member_for(descriptor, union, document)
        inner = {key: part for key, part in document.items() if key != "kind"}
        return {name: _argument(_fields(descriptor)[name], inner)}
    fields = _fields(descriptor)
    return {
        name: [_argument(fields[name], item) for item in value]
        if fields[name].repeated
        else _argument(fields[name], value)
        for name, value in document.items()
        if value is not None
    }


def _argument(field: _Field, value: Any) -> Any:
    if field.message is not None:
        return arguments(field.message, value)
    return value if field.enum is None else field.numbers[value]


def _member_for(descriptor: Descriptor, union: str, document: Mapping[str, Any]) -> str:
    if union == "kind":
        return str(document["kind"]).replace("-", "_")
    fields = _fields(descriptor)
    return next(
        name
        for name, field in fields.items()
        if field.message is not None and document.keys() <= _fields(field.message).keys()
    )


def _has_own_form(message: Descriptor) -> bool:
    """Whether its constructor takes the value as it is in the model."""
    return message.full_name in (_TIMESTAMP, _STRUCT) or _is_map(message)


def _is_map(message: Descriptor | None) -> bool:
    return message is not None and bool(message.GetOptions().map_entry)


@cache
def _union(descriptor: Descriptor) -> str | None:
    return next((name for name in ("kind", "pose") if name in descriptor.oneofs_by_name), None)


@cache
def _is_list(descriptor: Descriptor) -> bool:
    return [field.name for field in descriptor.fields] == ["items"]


def _words(enum: EnumDescriptor) -> dict[int, str]:
    """The model's values of an enum by number; events are called ``job.queued``."""
    prefix = re.sub(r"(?<!^)(?=[A-Z])", "_", enum.name).upper() + "_"
    separator = "." if enum.name == "EventKind" else "-"
    return {
        value.number: value.name.removeprefix(prefix).lower().replace("_", separator)
        for value in enum.values
        if value.number
    }


def _require_known_fields(message: Message, content: bytes) -> None:
    size = message.ByteSize()
    message.DiscardUnknownFields()  # of all messages inside, in C
    if message.ByteSize() != size:
        path, number = _unknown_field(type(message).FromString(content), "")
        raise _invalid(path, f"there is no field {number}" if number else "there is an unknown field", _NEWER)


def _unknown_field(message: Message, path: str) -> tuple[str, int]:
    """The path of a message with an unknown field, and the field's number; clears the message.

    0 if it is not in the first items of the lists.
    """
    for known, value in message.ListFields():
        if known.type == FieldDescriptor.TYPE_MESSAGE:
            for item in value[:_ITEMS_NAMED] if known.is_repeated else (value,):
                found = _unknown_field(item, f"{path}.{known.name}" if path else known.name)
                if found[1]:
                    return found
        message.ClearField(known.name)
    return path, _first_number(message.SerializeToString()[:_TAG_BYTES])


def _first_number(content: bytes) -> int:
    """The number of a message's first field, 0 without one.

    ``UnknownFieldSet`` has it too, and makes objects of all unknown fields, perhaps a million, for it.
    """
    tag = 0
    for place, byte in enumerate(content):
        tag |= (byte & 127) << 7 * place
        if byte < 128:
            break
    return tag >> 3


def _invalid(path: str, message: str, hint: str = _HINT) -> InvalidRequestError:
    fields = (FieldError(path, message),)
    return InvalidRequestError(sentence(path, message), errors=fields, hint=hint)
