from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class GetCapabilitiesRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class WorkerStatus(_message.Message):
    __slots__ = ("id", "alive", "heartbeat_age_s", "backend", "slots", "disk_full", "runners", "runner_bytes", "work")
    ID_FIELD_NUMBER: _ClassVar[int]
    ALIVE_FIELD_NUMBER: _ClassVar[int]
    HEARTBEAT_AGE_S_FIELD_NUMBER: _ClassVar[int]
    BACKEND_FIELD_NUMBER: _ClassVar[int]
    SLOTS_FIELD_NUMBER: _ClassVar[int]
    DISK_FULL_FIELD_NUMBER: _ClassVar[int]
    RUNNERS_FIELD_NUMBER: _ClassVar[int]
    RUNNER_BYTES_FIELD_NUMBER: _ClassVar[int]
    WORK_FIELD_NUMBER: _ClassVar[int]
    id: str
    alive: bool
    heartbeat_age_s: float
    backend: str
    slots: int
    disk_full: bool
    runners: int
    runner_bytes: int
    work: str
    def __init__(self, id: _Optional[str] = ..., alive: _Optional[bool] = ..., heartbeat_age_s: _Optional[float] = ..., backend: _Optional[str] = ..., slots: _Optional[int] = ..., disk_full: _Optional[bool] = ..., runners: _Optional[int] = ..., runner_bytes: _Optional[int] = ..., work: _Optional[str] = ...) -> None: ...

class Limits(_message.Message):
    __slots__ = ("image_bytes", "image_pixels", "image_decoding_bytes", "multipart_bytes", "json_bytes", "images_per_scene", "scenes_per_tenant", "open_jobs_per_tenant", "running_jobs_per_tenant", "open_uploads_per_tenant", "rankings_at_once_per_tenant", "rankings_queued_per_scene", "rankings_queued_per_key", "ranking_timeout_s", "event_streams_per_tenant", "candidates_per_ranking", "refusals_per_key", "partial_uploads_per_tenant", "video_bytes", "video_s")
    IMAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    IMAGE_PIXELS_FIELD_NUMBER: _ClassVar[int]
    IMAGE_DECODING_BYTES_FIELD_NUMBER: _ClassVar[int]
    MULTIPART_BYTES_FIELD_NUMBER: _ClassVar[int]
    JSON_BYTES_FIELD_NUMBER: _ClassVar[int]
    IMAGES_PER_SCENE_FIELD_NUMBER: _ClassVar[int]
    SCENES_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    OPEN_JOBS_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    RUNNING_JOBS_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    OPEN_UPLOADS_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    RANKINGS_AT_ONCE_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    RANKINGS_QUEUED_PER_SCENE_FIELD_NUMBER: _ClassVar[int]
    RANKINGS_QUEUED_PER_KEY_FIELD_NUMBER: _ClassVar[int]
    RANKING_TIMEOUT_S_FIELD_NUMBER: _ClassVar[int]
    EVENT_STREAMS_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_PER_RANKING_FIELD_NUMBER: _ClassVar[int]
    REFUSALS_PER_KEY_FIELD_NUMBER: _ClassVar[int]
    PARTIAL_UPLOADS_PER_TENANT_FIELD_NUMBER: _ClassVar[int]
    VIDEO_BYTES_FIELD_NUMBER: _ClassVar[int]
    VIDEO_S_FIELD_NUMBER: _ClassVar[int]
    image_bytes: int
    image_pixels: int
    image_decoding_bytes: int
    multipart_bytes: int
    json_bytes: int
    images_per_scene: int
    scenes_per_tenant: int
    open_jobs_per_tenant: int
    running_jobs_per_tenant: int
    open_uploads_per_tenant: int
    rankings_at_once_per_tenant: int
    rankings_queued_per_scene: int
    rankings_queued_per_key: int
    ranking_timeout_s: float
    event_streams_per_tenant: int
    candidates_per_ranking: int
    refusals_per_key: int
    partial_uploads_per_tenant: int
    video_bytes: int
    video_s: float
    def __init__(self, image_bytes: _Optional[int] = ..., image_pixels: _Optional[int] = ..., image_decoding_bytes: _Optional[int] = ..., multipart_bytes: _Optional[int] = ..., json_bytes: _Optional[int] = ..., images_per_scene: _Optional[int] = ..., scenes_per_tenant: _Optional[int] = ..., open_jobs_per_tenant: _Optional[int] = ..., running_jobs_per_tenant: _Optional[int] = ..., open_uploads_per_tenant: _Optional[int] = ..., rankings_at_once_per_tenant: _Optional[int] = ..., rankings_queued_per_scene: _Optional[int] = ..., rankings_queued_per_key: _Optional[int] = ..., ranking_timeout_s: _Optional[float] = ..., event_streams_per_tenant: _Optional[int] = ..., candidates_per_ranking: _Optional[int] = ..., refusals_per_key: _Optional[int] = ..., partial_uploads_per_tenant: _Optional[int] = ..., video_bytes: _Optional[int] = ..., video_s: _Optional[float] = ...) -> None: ...

class Basemap(_message.Message):
    __slots__ = ("kind", "url", "attribution")
    KIND_FIELD_NUMBER: _ClassVar[int]
    URL_FIELD_NUMBER: _ClassVar[int]
    ATTRIBUTION_FIELD_NUMBER: _ClassVar[int]
    kind: str
    url: str
    attribution: str
    def __init__(self, kind: _Optional[str] = ..., url: _Optional[str] = ..., attribution: _Optional[str] = ...) -> None: ...

class Capabilities(_message.Message):
    __slots__ = ("version", "api", "methods", "generators", "image_formats", "job_kinds", "workers", "keys_required", "limits", "mission_formats", "basemap")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    API_FIELD_NUMBER: _ClassVar[int]
    METHODS_FIELD_NUMBER: _ClassVar[int]
    GENERATORS_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FORMATS_FIELD_NUMBER: _ClassVar[int]
    JOB_KINDS_FIELD_NUMBER: _ClassVar[int]
    WORKERS_FIELD_NUMBER: _ClassVar[int]
    KEYS_REQUIRED_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    MISSION_FORMATS_FIELD_NUMBER: _ClassVar[int]
    BASEMAP_FIELD_NUMBER: _ClassVar[int]
    version: str
    api: _containers.RepeatedScalarFieldContainer[str]
    methods: _containers.RepeatedScalarFieldContainer[str]
    generators: _containers.RepeatedScalarFieldContainer[str]
    image_formats: _containers.RepeatedScalarFieldContainer[str]
    job_kinds: _containers.RepeatedScalarFieldContainer[str]
    workers: _containers.RepeatedCompositeFieldContainer[WorkerStatus]
    keys_required: bool
    limits: Limits
    mission_formats: _containers.RepeatedScalarFieldContainer[str]
    basemap: Basemap
    def __init__(self, version: _Optional[str] = ..., api: _Optional[_Iterable[str]] = ..., methods: _Optional[_Iterable[str]] = ..., generators: _Optional[_Iterable[str]] = ..., image_formats: _Optional[_Iterable[str]] = ..., job_kinds: _Optional[_Iterable[str]] = ..., workers: _Optional[_Iterable[_Union[WorkerStatus, _Mapping]]] = ..., keys_required: _Optional[bool] = ..., limits: _Optional[_Union[Limits, _Mapping]] = ..., mission_formats: _Optional[_Iterable[str]] = ..., basemap: _Optional[_Union[Basemap, _Mapping]] = ...) -> None: ...
