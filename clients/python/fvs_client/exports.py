"""What ``fvs_client`` exports."""

from fvs_client._async.client import AsyncClient
from fvs_client._async.jobs import AsyncJob
from fvs_client._async.plans import AsyncPlan
from fvs_client._async.rankings import AsyncRanking
from fvs_client._async.scenes import AsyncScene
from fvs_client._async.snapshots import AsyncSnapshot
from fvs_client._async.webhooks import AsyncWebhook
from fvs_client._sync.client import Client
from fvs_client._sync.jobs import Job
from fvs_client._sync.plans import Plan
from fvs_client._sync.rankings import Ranking
from fvs_client._sync.scenes import Scene
from fvs_client._sync.snapshots import Snapshot
from fvs_client._sync.webhooks import Webhook
from fvs_client.downloads import DownloadProgress
from fvs_client.errors import (
    AnswerTimeoutError,
    ApiError,
    ConflictError,
    ConnectionFailedError,
    DamagedDownloadError,
    DeadlineExceededError,
    DigestMismatchError,
    ForbiddenError,
    FvsError,
    GoneError,
    IdempotencyKeyReusedError,
    InvalidRequestError,
    JobCanceledError,
    JobError,
    JobFailedError,
    LimitExceededError,
    MalformedRequestError,
    NoSnapshotError,
    NotFoundError,
    OutOfSpaceError,
    PayloadTooLargeError,
    PreconditionFailedError,
    ServiceFailedError,
    UnauthenticatedError,
    UnavailableError,
    UnexpectedAnswerError,
    UnreadableFormatError,
    UnusedMaskError,
    WaitTimeoutError,
)
from fvs_client.height_model import HeightModel, HeightModelError
from fvs_client.models.display import Jpeg, Png
from fvs_client.models.missions import MissionFile, MissionSettings
from fvs_client.retries import NO_RETRIES, Retries
from fvs_client.uploads import Outcome, UploadedFile, UploadProgress, UploadReport
from fvs_schema.candidates import (
    AroundCurrent,
    Candidate,
    CandidateStatus,
    Dataset,
    Generator,
    Grid,
    InVolume,
    Orbit,
)
from fvs_schema.error_codes import ErrorCode, FieldError
from fvs_schema.events import Event, EventKind
from fvs_schema.images import DigestAnswer, Image, ImageMetadata, KnownImage, Prior, Registration, Verdict
from fvs_schema.jobs import JobFailure, JobKind, JobState, JobWaiting, WaitReason
from fvs_schema.missions import (
    Autopilot,
    Drone,
    Finish,
    MissionFormat,
    MissionOptions,
    MissionRequest,
    MissionView,
)
from fvs_schema.plans import CandidateTerms, Expectation, PlanRequest, PlanSummary, Stop, Tour
from fvs_schema.poses import FramePose, Pose, VehiclePose
from fvs_schema.rankings import (
    RankedCandidate,
    RankingRequest,
    RankingSummary,
    ScoredCandidate,
)
from fvs_schema.renders import RenderFormat, ViewImage
from fvs_schema.scenes import (
    Alignment,
    AlignmentStatus,
    AltitudeDatum,
    AutomaticWorld,
    CameraPrior,
    EnuWorld,
    ImageCounts,
    LocalWorld,
    Origin,
    Policy,
    Retention,
    SceneSize,
    Trigger,
    World,
)
from fvs_schema.service import Capabilities, Health, Limits, WorkerStatus
from fvs_schema.snapshots import Artifact, PinholeIntrinsics, SnapshotCameras, SnapshotMetrics, SnapshotView
from fvs_schema.terrain import Terrain, TerrainOfPoints
from fvs_schema.visits import Visit, VisitReport, VisitState
from fvs_schema.volumes import Box, Corridor, Cylinder, Prism, Shell, Volume
from fvs_schema.webhooks import WebhookState
from fvs_schema.words import Method as RankingMethod

__all__ = [
    "NO_RETRIES",
    "Alignment",
    "AlignmentStatus",
    "AltitudeDatum",
    "AnswerTimeoutError",
    "ApiError",
    "AroundCurrent",
    "Artifact",
    "AsyncClient",
    "AsyncJob",
    "AsyncPlan",
    "AsyncRanking",
    "AsyncScene",
    "AsyncSnapshot",
    "AsyncWebhook",
    "AutomaticWorld",
    "Autopilot",
    "Box",
    "CameraPrior",
    "Candidate",
    "CandidateStatus",
    "CandidateTerms",
    "Capabilities",
    "Client",
    "ConflictError",
    "ConnectionFailedError",
    "Corridor",
    "Cylinder",
    "DamagedDownloadError",
    "Dataset",
    "DeadlineExceededError",
    "DigestAnswer",
    "DigestMismatchError",
    "DownloadProgress",
    "Drone",
    "EnuWorld",
    "ErrorCode",
    "Event",
    "EventKind",
    "Expectation",
    "FieldError",
    "Finish",
    "ForbiddenError",
    "FramePose",
    "FvsError",
    "Generator",
    "GoneError",
    "Grid",
    "Health",
    "HeightModel",
    "HeightModelError",
    "IdempotencyKeyReusedError",
    "Image",
    "ImageCounts",
    "ImageMetadata",
    "InVolume",
    "InvalidRequestError",
    "Job",
    "JobCanceledError",
    "JobError",
    "JobFailedError",
    "JobFailure",
    "JobKind",
    "JobState",
    "JobWaiting",
    "Jpeg",
    "KnownImage",
    "LimitExceededError",
    "Limits",
    "LocalWorld",
    "MalformedRequestError",
    "MissionFile",
    "MissionFormat",
    "MissionOptions",
    "MissionRequest",
    "MissionSettings",
    "MissionView",
    "NoSnapshotError",
    "NotFoundError",
    "Orbit",
    "Origin",
    "OutOfSpaceError",
    "Outcome",
    "PayloadTooLargeError",
    "PinholeIntrinsics",
    "Plan",
    "PlanRequest",
    "PlanSummary",
    "Png",
    "Policy",
    "Pose",
    "PreconditionFailedError",
    "Prior",
    "Prism",
    "RankedCandidate",
    "Ranking",
    "RankingMethod",
    "RankingRequest",
    "RankingSummary",
    "Registration",
    "RenderFormat",
    "Retention",
    "Retries",
    "Scene",
    "SceneSize",
    "ScoredCandidate",
    "ServiceFailedError",
    "Shell",
    "Snapshot",
    "SnapshotCameras",
    "SnapshotMetrics",
    "SnapshotView",
    "Stop",
    "Terrain",
    "TerrainOfPoints",
    "Tour",
    "Trigger",
    "UnauthenticatedError",
    "UnavailableError",
    "UnexpectedAnswerError",
    "UnreadableFormatError",
    "UnusedMaskError",
    "UploadProgress",
    "UploadReport",
    "UploadedFile",
    "VehiclePose",
    "Verdict",
    "ViewImage",
    "Visit",
    "VisitReport",
    "VisitState",
    "Volume",
    "WaitReason",
    "WaitTimeoutError",
    "Webhook",
    "WebhookState",
    "WorkerStatus",
    "World",
]
