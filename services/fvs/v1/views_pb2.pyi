import datetime

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

class ViewImage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VIEW_IMAGE_UNSPECIFIED: _ClassVar[ViewImage]
    VIEW_IMAGE_RENDER: _ClassVar[ViewImage]
    VIEW_IMAGE_SPECTRUM: _ClassVar[ViewImage]

class CandidateStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CANDIDATE_STATUS_UNSPECIFIED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_RANKED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_VISITED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_OUT_OF_RANGE: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_OUT_OF_MODEL: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_LOW_COVERAGE: _ClassVar[CandidateStatus]

class GridLook(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    GRID_LOOK_UNSPECIFIED: _ClassVar[GridLook]
    GRID_LOOK_CENTRE: _ClassVar[GridLook]
    GRID_LOOK_DOWN: _ClassVar[GridLook]

class RankingWarningCode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RANKING_WARNING_CODE_UNSPECIFIED: _ClassVar[RankingWarningCode]
    RANKING_WARNING_CODE_ILL_CONDITIONED: _ClassVar[RankingWarningCode]
VIEW_IMAGE_UNSPECIFIED: ViewImage
VIEW_IMAGE_RENDER: ViewImage
VIEW_IMAGE_SPECTRUM: ViewImage
CANDIDATE_STATUS_UNSPECIFIED: CandidateStatus
CANDIDATE_STATUS_RANKED: CandidateStatus
CANDIDATE_STATUS_VISITED: CandidateStatus
CANDIDATE_STATUS_OUT_OF_RANGE: CandidateStatus
CANDIDATE_STATUS_OUT_OF_MODEL: CandidateStatus
CANDIDATE_STATUS_LOW_COVERAGE: CandidateStatus
GRID_LOOK_UNSPECIFIED: GridLook
GRID_LOOK_CENTRE: GridLook
GRID_LOOK_DOWN: GridLook
RANKING_WARNING_CODE_UNSPECIFIED: RankingWarningCode
RANKING_WARNING_CODE_ILL_CONDITIONED: RankingWarningCode

class PlanViewsRequest(_message.Message):
    __slots__ = ("scene_id", "plan")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    plan: PlanRequest
    def __init__(self, scene_id: _Optional[str] = ..., plan: _Optional[_Union[PlanRequest, _Mapping]] = ...) -> None: ...

class RankViewsRequest(_message.Message):
    __slots__ = ("scene_id", "ranking", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    ranking: RankingRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., ranking: _Optional[_Union[RankingRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class StreamRankViewsRequest(_message.Message):
    __slots__ = ("scene_id", "ranking", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    ranking: RankingRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., ranking: _Optional[_Union[RankingRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class GetRankingRequest(_message.Message):
    __slots__ = ("ranking_id",)
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    def __init__(self, ranking_id: _Optional[str] = ...) -> None: ...

class DeleteRankingRequest(_message.Message):
    __slots__ = ("ranking_id",)
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    def __init__(self, ranking_id: _Optional[str] = ...) -> None: ...

class RenderCandidateRequest(_message.Message):
    __slots__ = ("ranking_id", "candidate_id", "image")
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    CANDIDATE_ID_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    candidate_id: str
    image: ViewImage
    def __init__(self, ranking_id: _Optional[str] = ..., candidate_id: _Optional[str] = ..., image: _Optional[_Union[ViewImage, str]] = ...) -> None: ...

class CandidateRender(_message.Message):
    __slots__ = ("png",)
    PNG_FIELD_NUMBER: _ClassVar[int]
    png: bytes
    def __init__(self, png: _Optional[bytes] = ...) -> None: ...

class CandidateRequest(_message.Message):
    __slots__ = ("id", "pose")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ...) -> None: ...

class CandidateList(_message.Message):
    __slots__ = ("items",)
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[CandidateRequest]
    def __init__(self, items: _Optional[_Iterable[_Union[CandidateRequest, _Mapping]]] = ...) -> None: ...

class Orbit(_message.Message):
    __slots__ = ("count", "radius_m", "height_m", "centre")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    CENTRE_FIELD_NUMBER: _ClassVar[int]
    count: int
    radius_m: float
    height_m: float
    centre: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, count: _Optional[int] = ..., radius_m: _Optional[float] = ..., height_m: _Optional[float] = ..., centre: _Optional[_Iterable[float]] = ...) -> None: ...

class Grid(_message.Message):
    __slots__ = ("columns", "rows", "height_m", "look")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    LOOK_FIELD_NUMBER: _ClassVar[int]
    columns: int
    rows: int
    height_m: float
    look: GridLook
    def __init__(self, columns: _Optional[int] = ..., rows: _Optional[int] = ..., height_m: _Optional[float] = ..., look: _Optional[_Union[GridLook, str]] = ...) -> None: ...

class Dataset(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class AroundCurrent(_message.Message):
    __slots__ = ("count",)
    COUNT_FIELD_NUMBER: _ClassVar[int]
    count: int
    def __init__(self, count: _Optional[int] = ...) -> None: ...

class Generator(_message.Message):
    __slots__ = ("orbit", "grid", "dataset", "around_current")
    ORBIT_FIELD_NUMBER: _ClassVar[int]
    GRID_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    AROUND_CURRENT_FIELD_NUMBER: _ClassVar[int]
    orbit: Orbit
    grid: Grid
    dataset: Dataset
    around_current: AroundCurrent
    def __init__(self, orbit: _Optional[_Union[Orbit, _Mapping]] = ..., grid: _Optional[_Union[Grid, _Mapping]] = ..., dataset: _Optional[_Union[Dataset, _Mapping]] = ..., around_current: _Optional[_Union[AroundCurrent, _Mapping]] = ...) -> None: ...

class RankingRequest(_message.Message):
    __slots__ = ("candidates", "generator", "current_pose", "radius_m", "frame", "top_k", "method", "snapshot_id", "budget", "seed")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    CURRENT_POSE_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    TOP_K_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    BUDGET_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    candidates: CandidateList
    generator: Generator
    current_pose: _poses_pb2.Pose
    radius_m: float
    frame: _poses_pb2.PoseFrame
    top_k: int
    method: str
    snapshot_id: str
    budget: int
    seed: int
    def __init__(self, candidates: _Optional[_Union[CandidateList, _Mapping]] = ..., generator: _Optional[_Union[Generator, _Mapping]] = ..., current_pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., radius_m: _Optional[float] = ..., frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., top_k: _Optional[int] = ..., method: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., budget: _Optional[int] = ..., seed: _Optional[int] = ...) -> None: ...

class ScoredCandidate(_message.Message):
    __slots__ = ("id", "score", "status", "coverage", "distance_m", "pose")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    id: str
    score: float
    status: CandidateStatus
    coverage: float
    distance_m: float
    pose: _poses_pb2.Pose
    def __init__(self, id: _Optional[str] = ..., score: _Optional[float] = ..., status: _Optional[_Union[CandidateStatus, str]] = ..., coverage: _Optional[float] = ..., distance_m: _Optional[float] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ...) -> None: ...

class RankedCandidate(_message.Message):
    __slots__ = ("id", "rank", "score", "status", "coverage", "distance_m", "pose")
    ID_FIELD_NUMBER: _ClassVar[int]
    RANK_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    id: str
    rank: int
    score: float
    status: CandidateStatus
    coverage: float
    distance_m: float
    pose: _poses_pb2.Pose
    def __init__(self, id: _Optional[str] = ..., rank: _Optional[int] = ..., score: _Optional[float] = ..., status: _Optional[_Union[CandidateStatus, str]] = ..., coverage: _Optional[float] = ..., distance_m: _Optional[float] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ...) -> None: ...

class RankingWarning(_message.Message):
    __slots__ = ("code", "message", "hint")
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    code: RankingWarningCode
    message: str
    hint: str
    def __init__(self, code: _Optional[_Union[RankingWarningCode, str]] = ..., message: _Optional[str] = ..., hint: _Optional[str] = ...) -> None: ...

class Ranking(_message.Message):
    __slots__ = ("id", "scene_id", "snapshot_id", "request", "alignment", "origin", "iterations", "gaussians", "fallback", "candidates", "total", "seconds", "waited_s", "warnings", "created_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    FALLBACK_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    WAITED_S_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    snapshot_id: str
    request: RankingRequest
    alignment: _poses_pb2.Alignment
    origin: _poses_pb2.Origin
    iterations: int
    gaussians: int
    fallback: str
    candidates: _containers.RepeatedCompositeFieldContainer[RankedCandidate]
    total: int
    seconds: float
    waited_s: float
    warnings: _containers.RepeatedCompositeFieldContainer[RankingWarning]
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., request: _Optional[_Union[RankingRequest, _Mapping]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ..., iterations: _Optional[int] = ..., gaussians: _Optional[int] = ..., fallback: _Optional[str] = ..., candidates: _Optional[_Iterable[_Union[RankedCandidate, _Mapping]]] = ..., total: _Optional[int] = ..., seconds: _Optional[float] = ..., waited_s: _Optional[float] = ..., warnings: _Optional[_Iterable[_Union[RankingWarning, _Mapping]]] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class RankingPart(_message.Message):
    __slots__ = ("candidates", "ranking")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    candidates: _containers.RepeatedCompositeFieldContainer[ScoredCandidate]
    ranking: Ranking
    def __init__(self, candidates: _Optional[_Iterable[_Union[ScoredCandidate, _Mapping]]] = ..., ranking: _Optional[_Union[Ranking, _Mapping]] = ...) -> None: ...

class PoseList(_message.Message):
    __slots__ = ("items",)
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    def __init__(self, items: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ...) -> None: ...

class PlanRequest(_message.Message):
    __slots__ = ("candidates", "generator", "targets", "views", "distance_m", "home", "vehicles", "frame", "snapshot_id")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    TARGETS_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    HOME_FIELD_NUMBER: _ClassVar[int]
    VEHICLES_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    candidates: CandidateList
    generator: Generator
    targets: CandidateList
    views: int
    distance_m: float
    home: bool
    vehicles: PoseList
    frame: _poses_pb2.PoseFrame
    snapshot_id: str
    def __init__(self, candidates: _Optional[_Union[CandidateList, _Mapping]] = ..., generator: _Optional[_Union[Generator, _Mapping]] = ..., targets: _Optional[_Union[CandidateList, _Mapping]] = ..., views: _Optional[int] = ..., distance_m: _Optional[float] = ..., home: _Optional[bool] = ..., vehicles: _Optional[_Union[PoseList, _Mapping]] = ..., frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., snapshot_id: _Optional[str] = ...) -> None: ...

class Expectation(_message.Message):
    __slots__ = ("variance", "psnr_db", "low_db", "high_db")
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    PSNR_DB_FIELD_NUMBER: _ClassVar[int]
    LOW_DB_FIELD_NUMBER: _ClassVar[int]
    HIGH_DB_FIELD_NUMBER: _ClassVar[int]
    variance: float
    psnr_db: float
    low_db: float
    high_db: float
    def __init__(self, variance: _Optional[float] = ..., psnr_db: _Optional[float] = ..., low_db: _Optional[float] = ..., high_db: _Optional[float] = ...) -> None: ...

class Stop(_message.Message):
    __slots__ = ("id", "pose", "distance_m", "travel_m", "after")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    TRAVEL_M_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    distance_m: float
    travel_m: float
    after: Expectation
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., distance_m: _Optional[float] = ..., travel_m: _Optional[float] = ..., after: _Optional[_Union[Expectation, _Mapping]] = ...) -> None: ...

class Tour(_message.Message):
    __slots__ = ("vehicle", "stops", "length_m")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    STOPS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    vehicle: int
    stops: _containers.RepeatedCompositeFieldContainer[Stop]
    length_m: float
    def __init__(self, vehicle: _Optional[int] = ..., stops: _Optional[_Iterable[_Union[Stop, _Mapping]]] = ..., length_m: _Optional[float] = ...) -> None: ...

class CandidateTerms(_message.Message):
    __slots__ = ("id", "planned", "gain", "gain_in_plan", "variance", "distance_m", "chance", "helps")
    ID_FIELD_NUMBER: _ClassVar[int]
    PLANNED_FIELD_NUMBER: _ClassVar[int]
    GAIN_FIELD_NUMBER: _ClassVar[int]
    GAIN_IN_PLAN_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    CHANCE_FIELD_NUMBER: _ClassVar[int]
    HELPS_FIELD_NUMBER: _ClassVar[int]
    id: str
    planned: bool
    gain: float
    gain_in_plan: float
    variance: float
    distance_m: float
    chance: float
    helps: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, id: _Optional[str] = ..., planned: _Optional[bool] = ..., gain: _Optional[float] = ..., gain_in_plan: _Optional[float] = ..., variance: _Optional[float] = ..., distance_m: _Optional[float] = ..., chance: _Optional[float] = ..., helps: _Optional[_Iterable[str]] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("scene_id", "snapshot_id", "summary", "now", "end", "tours", "candidates", "photographed", "alignment", "origin", "warnings")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    NOW_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    TOURS_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    PHOTOGRAPHED_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    snapshot_id: str
    summary: str
    now: Expectation
    end: Expectation
    tours: _containers.RepeatedCompositeFieldContainer[Tour]
    candidates: _containers.RepeatedCompositeFieldContainer[CandidateTerms]
    photographed: _containers.RepeatedScalarFieldContainer[str]
    alignment: _poses_pb2.Alignment
    origin: _poses_pb2.Origin
    warnings: _containers.RepeatedCompositeFieldContainer[RankingWarning]
    def __init__(self, scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., summary: _Optional[str] = ..., now: _Optional[_Union[Expectation, _Mapping]] = ..., end: _Optional[_Union[Expectation, _Mapping]] = ..., tours: _Optional[_Iterable[_Union[Tour, _Mapping]]] = ..., candidates: _Optional[_Iterable[_Union[CandidateTerms, _Mapping]]] = ..., photographed: _Optional[_Iterable[str]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ..., warnings: _Optional[_Iterable[_Union[RankingWarning, _Mapping]]] = ...) -> None: ...
