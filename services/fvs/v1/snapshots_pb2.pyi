import datetime

from fvs.v1 import control_points_pb2 as _control_points_pb2
from fvs.v1 import downloads_pb2 as _downloads_pb2
from fvs.v1 import jobs_pb2 as _jobs_pb2
from fvs.v1 import poses_pb2 as _poses_pb2
from google.protobuf import empty_pb2 as _empty_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ListSnapshotsRequest(_message.Message):
    __slots__ = ("scene_id", "after", "limit")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: str
    limit: int
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[str] = ..., limit: _Optional[int] = ...) -> None: ...

class GetSnapshotRequest(_message.Message):
    __slots__ = ("snapshot_id",)
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    snapshot_id: str
    def __init__(self, snapshot_id: _Optional[str] = ...) -> None: ...

class ChangeSnapshotRequest(_message.Message):
    __slots__ = ("snapshot_id", "change")
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    CHANGE_FIELD_NUMBER: _ClassVar[int]
    snapshot_id: str
    change: SnapshotChange
    def __init__(self, snapshot_id: _Optional[str] = ..., change: _Optional[_Union[SnapshotChange, _Mapping]] = ...) -> None: ...

class DeleteSnapshotRequest(_message.Message):
    __slots__ = ("snapshot_id",)
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    snapshot_id: str
    def __init__(self, snapshot_id: _Optional[str] = ...) -> None: ...

class DownloadArtifactRequest(_message.Message):
    __slots__ = ("snapshot_id", "name", "start", "stop")
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    snapshot_id: str
    name: str
    start: int
    stop: int
    def __init__(self, snapshot_id: _Optional[str] = ..., name: _Optional[str] = ..., start: _Optional[int] = ..., stop: _Optional[int] = ...) -> None: ...

class Artifact(_message.Message):
    __slots__ = ("name", "media_type", "size_bytes", "sha256")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MEDIA_TYPE_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    name: str
    media_type: str
    size_bytes: int
    sha256: str
    def __init__(self, name: _Optional[str] = ..., media_type: _Optional[str] = ..., size_bytes: _Optional[int] = ..., sha256: _Optional[str] = ...) -> None: ...

class SnapshotMetrics(_message.Message):
    __slots__ = ("registered", "unregistered", "points", "iterations", "gaussians", "sh_degree", "psnr_db", "ssim", "new_images_psnr_db")
    REGISTERED_FIELD_NUMBER: _ClassVar[int]
    UNREGISTERED_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    SH_DEGREE_FIELD_NUMBER: _ClassVar[int]
    PSNR_DB_FIELD_NUMBER: _ClassVar[int]
    SSIM_FIELD_NUMBER: _ClassVar[int]
    NEW_IMAGES_PSNR_DB_FIELD_NUMBER: _ClassVar[int]
    registered: int
    unregistered: int
    points: int
    iterations: int
    gaussians: int
    sh_degree: int
    psnr_db: float
    ssim: float
    new_images_psnr_db: float
    def __init__(self, registered: _Optional[int] = ..., unregistered: _Optional[int] = ..., points: _Optional[int] = ..., iterations: _Optional[int] = ..., gaussians: _Optional[int] = ..., sh_degree: _Optional[int] = ..., psnr_db: _Optional[float] = ..., ssim: _Optional[float] = ..., new_images_psnr_db: _Optional[float] = ...) -> None: ...

class Snapshot(_message.Message):
    __slots__ = ("id", "scene_id", "job_id", "kind", "metrics", "alignment", "artifacts", "pinned", "created_at", "control")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ARTIFACTS_FIELD_NUMBER: _ClassVar[int]
    PINNED_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    CONTROL_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    job_id: str
    kind: _jobs_pb2.JobKind
    metrics: SnapshotMetrics
    alignment: _poses_pb2.Alignment
    artifacts: _containers.RepeatedCompositeFieldContainer[Artifact]
    pinned: bool
    created_at: _timestamp_pb2.Timestamp
    control: _control_points_pb2.ControlResiduals
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., job_id: _Optional[str] = ..., kind: _Optional[_Union[_jobs_pb2.JobKind, str]] = ..., metrics: _Optional[_Union[SnapshotMetrics, _Mapping]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., artifacts: _Optional[_Iterable[_Union[Artifact, _Mapping]]] = ..., pinned: _Optional[bool] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., control: _Optional[_Union[_control_points_pb2.ControlResiduals, _Mapping]] = ...) -> None: ...

class SnapshotChange(_message.Message):
    __slots__ = ("pinned",)
    PINNED_FIELD_NUMBER: _ClassVar[int]
    pinned: bool
    def __init__(self, pinned: _Optional[bool] = ...) -> None: ...

class SnapshotList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[Snapshot]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[Snapshot, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...
