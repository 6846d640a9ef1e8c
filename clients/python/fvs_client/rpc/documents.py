"""JSON documents of REST as messages of ``fvs.v1`` and back, derived from the descriptors.

Fields have the same names. What JSON and protobuf write differently follows a few rules:

* null is an absent field, and so is an enum's zero and an empty list of doubles, which is a vector;
* an enum value is the word in capitals after the enum's name: "queued" is ``JOB_STATE_QUEUED``;
* a message whose only field is ``items`` is a list, which can be present and empty;
* a message with a ``oneof`` ``kind`` is an object with a ``kind``; one with a ``oneof`` ``pose`` is an object
  that is recognised by its fields;
* timestamps are text, and a ``Struct`` is any object.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from google.protobuf.descriptor import Descriptor, EnumDescriptor, FieldDescriptor
from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message

_TIMESTAMP, _STRUCT = "google.protobuf.Timestamp", "google.protobuf.Struct"
_DOUBLE = FieldDescriptor.CPPTYPE_DOUBLE
_BITS = {FieldDescriptor.CPPTYPE_INT32: 32, FieldDescriptor.CPPTYPE_INT64: 64}


def document_of(message: Message) -> Any:
    """The JSON document of a message."""
    descriptor = message.DESCRIPTOR
    if descriptor.full_name == _TIMESTAMP:
        return str(message.ToJsonString())
    if descriptor.full_name == _STRUCT:
        return _plain(MessageToDict(message))
    if _is_list(descriptor):
        items = descriptor.fields_by_name["items"]
        return [_single(items, item) for item in message.items]
    union = _union(descriptor)
    if union is None:
        return {field.name: _value(message, field) for field in descriptor.fields}
    member = message.WhichOneof(union)
    if member is None:  # of a newer service
        return None
    kind = {"kind": member.replace("_", "-")} if union == "kind" else {}
    return {**kind, **document_of(getattr(message, member))}


def fill(message: Message, document: Any) -> None:
    """Set the fields of ``message`` from a JSON document.

    Numbers may be text, as in a query. Raises ``ValueError`` for what the contract cannot express.
    """
    descriptor = message.DESCRIPTOR
    if descriptor.full_name == _TIMESTAMP:
        message.FromJsonString(document)
    elif _is_list(descriptor):
        items = descriptor.fields_by_name["items"]
        if items.message_type is None:
            message.items.extend(_scalar(items, item) for item in document)
            return
        for item in document:
            fill(message.items.add(), item)
    elif (union := _union(descriptor)) is not None:
        member = getattr(message, _member(descriptor, union, document))
        member.SetInParent()
        fill(member, {name: value for name, value in document.items() if name != "kind"})
    else:
        for name, value in document.items():
            if value is not None:
                _set(message, descriptor.fields_by_name[name], value)


def _plain(value: Any) -> Any:
    """The value of a ``Struct``, whose numbers are all doubles, with whole numbers as integers."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _value(message: Message, field: FieldDescriptor) -> Any:
    value = getattr(message, field.name)
    if field.is_repeated:
        if field.cpp_type == _DOUBLE and not value:
            return None
        return [_single(field, item) for item in value]
    if field.has_presence and not message.HasField(field.name):
        return None
    return _single(field, value)


def _single(field: FieldDescriptor, value: Any) -> Any:
    if field.message_type is not None:
        return document_of(value)
    if field.enum_type is None:
        return value
    return _words(field.enum_type).get(value, str(value)) if value else None


def _set(message: Message, field: FieldDescriptor, value: Any) -> None:
    if field.message_type is None:
        if field.is_repeated:
            getattr(message, field.name).extend(_scalar(field, item) for item in value)
        else:
            setattr(message, field.name, _scalar(field, value))
        return
    inner = getattr(message, field.name)
    if field.is_repeated:
        for item in value:
            fill(inner.add(), item)
        return
    inner.SetInParent()
    fill(inner, value)


def _scalar(field: FieldDescriptor, value: Any) -> Any:
    if field.enum_type is not None:
        numbers = {word: number for number, word in _words(field.enum_type).items()}
        if value not in numbers:
            raise ValueError(f"{field.name}: it is not one of {', '.join(numbers)}")
        return numbers[value]
    if (bits := _BITS.get(field.cpp_type)) is not None:
        value = int(value)
        if abs(value) >= 2 ** (bits - 1):
            raise ValueError(f"{field.name}: it has more than {bits} bits")
    return float(value) if field.cpp_type == _DOUBLE else value


def _member(descriptor: Descriptor, union: str, document: Mapping[str, Any]) -> str:
    if union == "kind":
        return str(document["kind"]).replace("-", "_")
    return next(
        str(field.name)
        for field in descriptor.fields
        if document.keys() <= {inner.name for inner in field.message_type.fields}
    )


@cache
def _union(descriptor: Descriptor) -> str | None:
    return next((name for name in ("kind", "pose") if name in descriptor.oneofs_by_name), None)


@cache
def _is_list(descriptor: Descriptor) -> bool:
    return [field.name for field in descriptor.fields] == ["items"]


@cache
def _words(enum: EnumDescriptor) -> Mapping[int, str]:
    """The words of an enum by number; events are called ``job.queued``."""
    prefix = re.sub(r"(?<!^)(?=[A-Z])", "_", enum.name).upper() + "_"
    separator = "." if enum.name == "EventKind" else "-"
    return {
        value.number: value.name.removeprefix(prefix).lower().replace("_", separator)
        for value in enum.values
        if value.number
    }
