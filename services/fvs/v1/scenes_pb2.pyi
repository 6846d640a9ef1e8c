import datetime

from fvs.v1 import control_points_pb2 as _control_points_pb2
from fvs.v1 import events_pb2 as _events_pb2
from fvs.v1 import jobs_pb2 as _jobs_pb2
from fvs.v1 import poses_pb2 as _poses_pb2
from google.protobuf import empty_pb2 as _empty_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Trigger(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    TRIGGER_UNSPECIFIED: _ClassVar[Trigger]
    TRIGGER_ON_REQUEST: _ClassVar[Trigger]
    TRIGGER_EACH_IMAGE: _ClassVar[Trigger]
    TRIGGER_EVERY_K_IMAGES: _ClassVar[Trigger]
TRIGGER_UNSPECIFIED: Trigger
TRIGGER_ON_REQUEST: Trigger
TRIGGER_EACH_IMAGE: Trigger
TRIGGER_EVERY_K_IMAGES: Trigger

class CreateSceneRequest(_message.Message):
    __slots__ = ("scene", "idempotency_key")
    SCENE_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene: SceneRequest
    idempotency_key: str
    def __init__(self, scene: _Optional[_Union[SceneRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class ListScenesRequest(_message.Message):
    __slots__ = ("after", "limit", "name", "search")
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SEARCH_FIELD_NUMBER: _ClassVar[int]
    after: str
    limit: int
    name: str
    search: str
    def __init__(self, after: _Optional[str] = ..., limit: _Optional[int] = ..., name: _Optional[str] = ..., search: _Optional[str] = ...) -> None: ...

class GetSceneRequest(_message.Message):
    __slots__ = ("scene_id",)
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    def __init__(self, scene_id: _Optional[str] = ...) -> None: ...

class ChangeSceneRequest(_message.Message):
    __slots__ = ("scene_id", "change", "etag")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    CHANGE_FIELD_NUMBER: _ClassVar[int]
    ETAG_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    change: SceneChange
    etag: str
    def __init__(self, scene_id: _Optional[str] = ..., change: _Optional[_Union[SceneChange, _Mapping]] = ..., etag: _Optional[str] = ...) -> None: ...

class DeleteSceneRequest(_message.Message):
    __slots__ = ("scene_id", "etag")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    ETAG_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    etag: str
    def __init__(self, scene_id: _Optional[str] = ..., etag: _Optional[str] = ...) -> None: ...

class SetControlPointsRequest(_message.Message):
    __slots__ = ("scene_id", "points")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    points: _control_points_pb2.ControlPoints
    def __init__(self, scene_id: _Optional[str] = ..., points: _Optional[_Union[_control_points_pb2.ControlPoints, _Mapping]] = ...) -> None: ...

class GetControlPointsRequest(_message.Message):
    __slots__ = ("scene_id",)
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    def __init__(self, scene_id: _Optional[str] = ...) -> None: ...

class DeleteControlPointsRequest(_message.Message):
    __slots__ = ("scene_id",)
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    def __init__(self, scene_id: _Optional[str] = ...) -> None: ...

class GetSceneSizeRequest(_message.Message):
    __slots__ = ("scene_id",)
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    def __init__(self, scene_id: _Optional[str] = ...) -> None: ...

class WatchEventsRequest(_message.Message):
    __slots__ = ("scene_id", "after", "tail")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    TAIL_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: int
    tail: bool
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[int] = ..., tail: _Optional[bool] = ...) -> None: ...

class AutomaticWorld(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class LocalWorld(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class EnuWorld(_message.Message):
    __slots__ = ("origin",)
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    origin: _poses_pb2.Origin
    def __init__(self, origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ...) -> None: ...

class World(_message.Message):
    __slots__ = ("automatic", "local", "enu")
    AUTOMATIC_FIELD_NUMBER: _ClassVar[int]
    LOCAL_FIELD_NUMBER: _ClassVar[int]
    ENU_FIELD_NUMBER: _ClassVar[int]
    automatic: AutomaticWorld
    local: LocalWorld
    enu: EnuWorld
    def __init__(self, automatic: _Optional[_Union[AutomaticWorld, _Mapping]] = ..., local: _Optional[_Union[LocalWorld, _Mapping]] = ..., enu: _Optional[_Union[EnuWorld, _Mapping]] = ...) -> None: ...

class CameraPrior(_message.Message):
    __slots__ = ("width_px", "focal_length_px")
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    FOCAL_LENGTH_PX_FIELD_NUMBER: _ClassVar[int]
    width_px: int
    focal_length_px: float
    def __init__(self, width_px: _Optional[int] = ..., focal_length_px: _Optional[float] = ...) -> None: ...

class Policy(_message.Message):
    __slots__ = ("trigger", "k", "first")
    TRIGGER_FIELD_NUMBER: _ClassVar[int]
    K_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    trigger: Trigger
    k: int
    first: int
    def __init__(self, trigger: _Optional[_Union[Trigger, str]] = ..., k: _Optional[int] = ..., first: _Optional[int] = ...) -> None: ...

class Retention(_message.Message):
    __slots__ = ("snapshots", "snapshot_days", "rankings", "ranking_days", "plans", "plan_days")
    SNAPSHOTS_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_DAYS_FIELD_NUMBER: _ClassVar[int]
    RANKINGS_FIELD_NUMBER: _ClassVar[int]
    RANKING_DAYS_FIELD_NUMBER: _ClassVar[int]
    PLANS_FIELD_NUMBER: _ClassVar[int]
    PLAN_DAYS_FIELD_NUMBER: _ClassVar[int]
    snapshots: int
    snapshot_days: float
    rankings: int
    ranking_days: float
    plans: int
    plan_days: float
    def __init__(self, snapshots: _Optional[int] = ..., snapshot_days: _Optional[float] = ..., rankings: _Optional[int] = ..., ranking_days: _Optional[float] = ..., plans: _Optional[int] = ..., plan_days: _Optional[float] = ...) -> None: ...

class SceneRequest(_message.Message):
    __slots__ = ("name", "world", "camera", "policy", "retention")
    NAME_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    RETENTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    world: World
    camera: CameraPrior
    policy: Policy
    retention: Retention
    def __init__(self, name: _Optional[str] = ..., world: _Optional[_Union[World, _Mapping]] = ..., camera: _Optional[_Union[CameraPrior, _Mapping]] = ..., policy: _Optional[_Union[Policy, _Mapping]] = ..., retention: _Optional[_Union[Retention, _Mapping]] = ...) -> None: ...

class SceneChange(_message.Message):
    __slots__ = ("name", "policy", "retention")
    NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    RETENTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    policy: Policy
    retention: Retention
    def __init__(self, name: _Optional[str] = ..., policy: _Optional[_Union[Policy, _Mapping]] = ..., retention: _Optional[_Union[Retention, _Mapping]] = ...) -> None: ...

class SceneSize(_message.Message):
    __slots__ = ("scene_id", "images_bytes", "artifacts_bytes", "working_bytes", "total_bytes")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    IMAGES_BYTES_FIELD_NUMBER: _ClassVar[int]
    ARTIFACTS_BYTES_FIELD_NUMBER: _ClassVar[int]
    WORKING_BYTES_FIELD_NUMBER: _ClassVar[int]
    TOTAL_BYTES_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    images_bytes: int
    artifacts_bytes: int
    working_bytes: int
    total_bytes: int
    def __init__(self, scene_id: _Optional[str] = ..., images_bytes: _Optional[int] = ..., artifacts_bytes: _Optional[int] = ..., working_bytes: _Optional[int] = ..., total_bytes: _Optional[int] = ...) -> None: ...

class ImageCounts(_message.Message):
    __slots__ = ("received", "accepted", "rejected", "pending", "excluded", "quarantined")
    RECEIVED_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REJECTED_FIELD_NUMBER: _ClassVar[int]
    PENDING_FIELD_NUMBER: _ClassVar[int]
    EXCLUDED_FIELD_NUMBER: _ClassVar[int]
    QUARANTINED_FIELD_NUMBER: _ClassVar[int]
    received: int
    accepted: int
    rejected: int
    pending: int
    excluded: int
    quarantined: int
    def __init__(self, received: _Optional[int] = ..., accepted: _Optional[int] = ..., rejected: _Optional[int] = ..., pending: _Optional[int] = ..., excluded: _Optional[int] = ..., quarantined: _Optional[int] = ...) -> None: ...

class Scene(_message.Message):
    __slots__ = ("id", "name", "world", "origin", "camera", "policy", "retention", "image_counts", "snapshot_id", "alignment", "created_at", "etag", "snapshot_created_at", "job")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    WORLD_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    RETENTION_FIELD_NUMBER: _ClassVar[int]
    IMAGE_COUNTS_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    ETAG_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    JOB_FIELD_NUMBER: _ClassVar[int]
    id: str
    name: str
    world: World
    origin: _poses_pb2.Origin
    camera: CameraPrior
    policy: Policy
    retention: Retention
    image_counts: ImageCounts
    snapshot_id: str
    alignment: _poses_pb2.Alignment
    created_at: _timestamp_pb2.Timestamp
    etag: str
    snapshot_created_at: _timestamp_pb2.Timestamp
    job: SceneJob
    def __init__(self, id: _Optional[str] = ..., name: _Optional[str] = ..., world: _Optional[_Union[World, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ..., camera: _Optional[_Union[CameraPrior, _Mapping]] = ..., policy: _Optional[_Union[Policy, _Mapping]] = ..., retention: _Optional[_Union[Retention, _Mapping]] = ..., image_counts: _Optional[_Union[ImageCounts, _Mapping]] = ..., snapshot_id: _Optional[str] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., etag: _Optional[str] = ..., snapshot_created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., job: _Optional[_Union[SceneJob, _Mapping]] = ...) -> None: ...

class SceneJob(_message.Message):
    __slots__ = ("id", "kind", "state")
    ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    id: str
    kind: _jobs_pb2.JobKind
    state: _jobs_pb2.JobState
    def __init__(self, id: _Optional[str] = ..., kind: _Optional[_Union[_jobs_pb2.JobKind, str]] = ..., state: _Optional[_Union[_jobs_pb2.JobState, str]] = ...) -> None: ...

class SceneList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[Scene]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[Scene, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...
