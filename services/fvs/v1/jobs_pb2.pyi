import datetime

from fvs.v1 import findings_pb2 as _findings_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class JobKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    JOB_KIND_UNSPECIFIED: _ClassVar[JobKind]
    JOB_KIND_UPDATE: _ClassVar[JobKind]
    JOB_KIND_FINE: _ClassVar[JobKind]
    JOB_KIND_FRAMES: _ClassVar[JobKind]

class JobState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    JOB_STATE_UNSPECIFIED: _ClassVar[JobState]
    JOB_STATE_QUEUED: _ClassVar[JobState]
    JOB_STATE_RUNNING: _ClassVar[JobState]
    JOB_STATE_SUCCEEDED: _ClassVar[JobState]
    JOB_STATE_FAILED: _ClassVar[JobState]
    JOB_STATE_CANCELED: _ClassVar[JobState]

class Stage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STAGE_UNSPECIFIED: _ClassVar[Stage]
    STAGE_START: _ClassVar[Stage]
    STAGE_RESTORE: _ClassVar[Stage]
    STAGE_IMAGES: _ClassVar[Stage]
    STAGE_NORMALISE: _ClassVar[Stage]
    STAGE_COMPILE: _ClassVar[Stage]
    STAGE_FIRST_MODEL: _ClassVar[Stage]
    STAGE_FEATURES: _ClassVar[Stage]
    STAGE_PAIRS: _ClassVar[Stage]
    STAGE_MATCHING: _ClassVar[Stage]
    STAGE_CALIBRATION: _ClassVar[Stage]
    STAGE_GLOBAL_MAPPING: _ClassVar[Stage]
    STAGE_INCREMENTAL_MAPPING: _ClassVar[Stage]
    STAGE_REGISTRATION: _ClassVar[Stage]
    STAGE_LOCALISATION: _ClassVar[Stage]
    STAGE_TRIANGULATION: _ClassVar[Stage]
    STAGE_EVIDENCE: _ClassVar[Stage]
    STAGE_UNDISTORT: _ClassVar[Stage]
    STAGE_LOAD: _ClassVar[Stage]
    STAGE_EVALUATE: _ClassVar[Stage]
    STAGE_QUICK_TRAINING: _ClassVar[Stage]
    STAGE_QUICK_SNAPSHOT: _ClassVar[Stage]
    STAGE_TRAINING: _ClassVar[Stage]
    STAGE_SNAPSHOT: _ClassVar[Stage]
    STAGE_COMMIT: _ClassVar[Stage]
    STAGE_SELECT: _ClassVar[Stage]
    STAGE_EXPERIMENT: _ClassVar[Stage]
    STAGE_CALIBRATE: _ClassVar[Stage]
    STAGE_PHOTOGRAPHS: _ClassVar[Stage]
    STAGE_FRAMES: _ClassVar[Stage]
    STAGE_COVERAGE: _ClassVar[Stage]
    STAGE_INFORMATION: _ClassVar[Stage]
    STAGE_FEASIBILITY: _ClassVar[Stage]
    STAGE_ESTIMATE: _ClassVar[Stage]
    STAGE_SCORE: _ClassVar[Stage]
    STAGE_RENDER: _ClassVar[Stage]
    STAGE_CONTACT_SHEET: _ClassVar[Stage]
    STAGE_CLEANING: _ClassVar[Stage]

class WaitReason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    WAIT_REASON_UNSPECIFIED: _ClassVar[WaitReason]
    WAIT_REASON_QUEUE: _ClassVar[WaitReason]
    WAIT_REASON_SCENE: _ClassVar[WaitReason]
    WAIT_REASON_TENANT_LIMIT: _ClassVar[WaitReason]
    WAIT_REASON_MEMORY: _ClassVar[WaitReason]
    WAIT_REASON_DISK: _ClassVar[WaitReason]
    WAIT_REASON_NO_WORKER: _ClassVar[WaitReason]
    WAIT_REASON_CLUSTER: _ClassVar[WaitReason]
    WAIT_REASON_NODE: _ClassVar[WaitReason]
    WAIT_REASON_GPU: _ClassVar[WaitReason]
    WAIT_REASON_NO_NODE: _ClassVar[WaitReason]
JOB_KIND_UNSPECIFIED: JobKind
JOB_KIND_UPDATE: JobKind
JOB_KIND_FINE: JobKind
JOB_KIND_FRAMES: JobKind
JOB_STATE_UNSPECIFIED: JobState
JOB_STATE_QUEUED: JobState
JOB_STATE_RUNNING: JobState
JOB_STATE_SUCCEEDED: JobState
JOB_STATE_FAILED: JobState
JOB_STATE_CANCELED: JobState
STAGE_UNSPECIFIED: Stage
STAGE_START: Stage
STAGE_RESTORE: Stage
STAGE_IMAGES: Stage
STAGE_NORMALISE: Stage
STAGE_COMPILE: Stage
STAGE_FIRST_MODEL: Stage
STAGE_FEATURES: Stage
STAGE_PAIRS: Stage
STAGE_MATCHING: Stage
STAGE_CALIBRATION: Stage
STAGE_GLOBAL_MAPPING: Stage
STAGE_INCREMENTAL_MAPPING: Stage
STAGE_REGISTRATION: Stage
STAGE_LOCALISATION: Stage
STAGE_TRIANGULATION: Stage
STAGE_EVIDENCE: Stage
STAGE_UNDISTORT: Stage
STAGE_LOAD: Stage
STAGE_EVALUATE: Stage
STAGE_QUICK_TRAINING: Stage
STAGE_QUICK_SNAPSHOT: Stage
STAGE_TRAINING: Stage
STAGE_SNAPSHOT: Stage
STAGE_COMMIT: Stage
STAGE_SELECT: Stage
STAGE_EXPERIMENT: Stage
STAGE_CALIBRATE: Stage
STAGE_PHOTOGRAPHS: Stage
STAGE_FRAMES: Stage
STAGE_COVERAGE: Stage
STAGE_INFORMATION: Stage
STAGE_FEASIBILITY: Stage
STAGE_ESTIMATE: Stage
STAGE_SCORE: Stage
STAGE_RENDER: Stage
STAGE_CONTACT_SHEET: Stage
STAGE_CLEANING: Stage
WAIT_REASON_UNSPECIFIED: WaitReason
WAIT_REASON_QUEUE: WaitReason
WAIT_REASON_SCENE: WaitReason
WAIT_REASON_TENANT_LIMIT: WaitReason
WAIT_REASON_MEMORY: WaitReason
WAIT_REASON_DISK: WaitReason
WAIT_REASON_NO_WORKER: WaitReason
WAIT_REASON_CLUSTER: WaitReason
WAIT_REASON_NODE: WaitReason
WAIT_REASON_GPU: WaitReason
WAIT_REASON_NO_NODE: WaitReason

class CreateJobRequest(_message.Message):
    __slots__ = ("scene_id", "job", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    JOB_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    job: JobRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., job: _Optional[_Union[JobRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class ListJobsRequest(_message.Message):
    __slots__ = ("scene_id", "after", "limit", "state")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: str
    limit: int
    state: _containers.RepeatedScalarFieldContainer[JobState]
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[str] = ..., limit: _Optional[int] = ..., state: _Optional[_Iterable[_Union[JobState, str]]] = ...) -> None: ...

class GetJobRequest(_message.Message):
    __slots__ = ("job_id", "wait_s")
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    WAIT_S_FIELD_NUMBER: _ClassVar[int]
    job_id: str
    wait_s: float
    def __init__(self, job_id: _Optional[str] = ..., wait_s: _Optional[float] = ...) -> None: ...

class CancelJobRequest(_message.Message):
    __slots__ = ("job_id",)
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    job_id: str
    def __init__(self, job_id: _Optional[str] = ...) -> None: ...

class RetryJobRequest(_message.Message):
    __slots__ = ("job_id",)
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    job_id: str
    def __init__(self, job_id: _Optional[str] = ...) -> None: ...

class WatchJobRequest(_message.Message):
    __slots__ = ("job_id",)
    JOB_ID_FIELD_NUMBER: _ClassVar[int]
    job_id: str
    def __init__(self, job_id: _Optional[str] = ...) -> None: ...

class JobRequest(_message.Message):
    __slots__ = ("kind", "iterations", "long_side_px", "test_every")
    KIND_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    LONG_SIDE_PX_FIELD_NUMBER: _ClassVar[int]
    TEST_EVERY_FIELD_NUMBER: _ClassVar[int]
    kind: JobKind
    iterations: int
    long_side_px: int
    test_every: int
    def __init__(self, kind: _Optional[_Union[JobKind, str]] = ..., iterations: _Optional[int] = ..., long_side_px: _Optional[int] = ..., test_every: _Optional[int] = ...) -> None: ...

class JobFailure(_message.Message):
    __slots__ = ("code", "message", "hint", "retryable", "stage")
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    RETRYABLE_FIELD_NUMBER: _ClassVar[int]
    STAGE_FIELD_NUMBER: _ClassVar[int]
    code: str
    message: str
    hint: str
    retryable: bool
    stage: Stage
    def __init__(self, code: _Optional[str] = ..., message: _Optional[str] = ..., hint: _Optional[str] = ..., retryable: _Optional[bool] = ..., stage: _Optional[_Union[Stage, str]] = ...) -> None: ...

class JobWaiting(_message.Message):
    __slots__ = ("place", "reason", "message", "eta_s")
    PLACE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    ETA_S_FIELD_NUMBER: _ClassVar[int]
    place: int
    reason: WaitReason
    message: str
    eta_s: float
    def __init__(self, place: _Optional[int] = ..., reason: _Optional[_Union[WaitReason, str]] = ..., message: _Optional[str] = ..., eta_s: _Optional[float] = ...) -> None: ...

class Job(_message.Message):
    __slots__ = ("id", "scene_id", "kind", "request", "state", "stage", "progress", "eta_s", "waiting", "attempt", "cancel_requested", "warnings", "error", "snapshot_id", "created_at", "started_at", "finished_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STAGE_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    ETA_S_FIELD_NUMBER: _ClassVar[int]
    WAITING_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    CANCEL_REQUESTED_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    STARTED_AT_FIELD_NUMBER: _ClassVar[int]
    FINISHED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    kind: JobKind
    request: JobRequest
    state: JobState
    stage: Stage
    progress: float
    eta_s: float
    waiting: JobWaiting
    attempt: int
    cancel_requested: bool
    warnings: _containers.RepeatedCompositeFieldContainer[_findings_pb2.Notice]
    error: JobFailure
    snapshot_id: str
    created_at: _timestamp_pb2.Timestamp
    started_at: _timestamp_pb2.Timestamp
    finished_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., kind: _Optional[_Union[JobKind, str]] = ..., request: _Optional[_Union[JobRequest, _Mapping]] = ..., state: _Optional[_Union[JobState, str]] = ..., stage: _Optional[_Union[Stage, str]] = ..., progress: _Optional[float] = ..., eta_s: _Optional[float] = ..., waiting: _Optional[_Union[JobWaiting, _Mapping]] = ..., attempt: _Optional[int] = ..., cancel_requested: _Optional[bool] = ..., warnings: _Optional[_Iterable[_Union[_findings_pb2.Notice, _Mapping]]] = ..., error: _Optional[_Union[JobFailure, _Mapping]] = ..., snapshot_id: _Optional[str] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., started_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., finished_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class JobList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[Job]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[Job, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...
