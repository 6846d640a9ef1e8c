import datetime

from google.protobuf import struct_pb2 as _struct_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class EventKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    EVENT_KIND_UNSPECIFIED: _ClassVar[EventKind]
    EVENT_KIND_SCENE_CREATED: _ClassVar[EventKind]
    EVENT_KIND_SCENE_CHANGED: _ClassVar[EventKind]
    EVENT_KIND_SCENE_DELETED: _ClassVar[EventKind]
    EVENT_KIND_IMAGE_RECEIVED: _ClassVar[EventKind]
    EVENT_KIND_IMAGE_EXCLUDED: _ClassVar[EventKind]
    EVENT_KIND_IMAGE_INCLUDED: _ClassVar[EventKind]
    EVENT_KIND_IMAGE_QUARANTINED: _ClassVar[EventKind]
    EVENT_KIND_IMAGE_DELETED: _ClassVar[EventKind]
    EVENT_KIND_JOB_QUEUED: _ClassVar[EventKind]
    EVENT_KIND_JOB_STARTED: _ClassVar[EventKind]
    EVENT_KIND_JOB_PROGRESS: _ClassVar[EventKind]
    EVENT_KIND_JOB_SUCCEEDED: _ClassVar[EventKind]
    EVENT_KIND_JOB_FAILED: _ClassVar[EventKind]
    EVENT_KIND_JOB_CANCELED: _ClassVar[EventKind]
    EVENT_KIND_SNAPSHOT_CREATED: _ClassVar[EventKind]
    EVENT_KIND_SNAPSHOT_DELETED: _ClassVar[EventKind]
    EVENT_KIND_RANKING_CREATED: _ClassVar[EventKind]
    EVENT_KIND_RANKING_DELETED: _ClassVar[EventKind]
    EVENT_KIND_PLAN_CREATED: _ClassVar[EventKind]
    EVENT_KIND_PLAN_DELETED: _ClassVar[EventKind]
    EVENT_KIND_VISITS_REPORTED: _ClassVar[EventKind]
    EVENT_KIND_EVENTS_DELETED: _ClassVar[EventKind]
EVENT_KIND_UNSPECIFIED: EventKind
EVENT_KIND_SCENE_CREATED: EventKind
EVENT_KIND_SCENE_CHANGED: EventKind
EVENT_KIND_SCENE_DELETED: EventKind
EVENT_KIND_IMAGE_RECEIVED: EventKind
EVENT_KIND_IMAGE_EXCLUDED: EventKind
EVENT_KIND_IMAGE_INCLUDED: EventKind
EVENT_KIND_IMAGE_QUARANTINED: EventKind
EVENT_KIND_IMAGE_DELETED: EventKind
EVENT_KIND_JOB_QUEUED: EventKind
EVENT_KIND_JOB_STARTED: EventKind
EVENT_KIND_JOB_PROGRESS: EventKind
EVENT_KIND_JOB_SUCCEEDED: EventKind
EVENT_KIND_JOB_FAILED: EventKind
EVENT_KIND_JOB_CANCELED: EventKind
EVENT_KIND_SNAPSHOT_CREATED: EventKind
EVENT_KIND_SNAPSHOT_DELETED: EventKind
EVENT_KIND_RANKING_CREATED: EventKind
EVENT_KIND_RANKING_DELETED: EventKind
EVENT_KIND_PLAN_CREATED: EventKind
EVENT_KIND_PLAN_DELETED: EventKind
EVENT_KIND_VISITS_REPORTED: EventKind
EVENT_KIND_EVENTS_DELETED: EventKind

class Event(_message.Message):
    __slots__ = ("number", "scene_id", "kind", "data", "created_at")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    number: int
    scene_id: str
    kind: EventKind
    data: _struct_pb2.Struct
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, number: _Optional[int] = ..., scene_id: _Optional[str] = ..., kind: _Optional[_Union[EventKind, str]] = ..., data: _Optional[_Union[_struct_pb2.Struct, _Mapping]] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...
