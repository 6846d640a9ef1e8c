"""Client of the fvs service: upload images, update the model, rank the next views to photograph.

``Client`` blocks; ``AsyncClient`` has the same methods for ``await``.
"""

from fvs_client._async.client import AsyncClient
from fvs_client._async.jobs import AsyncJob
from fvs_client._async.rankings import AsyncRanking
from fvs_client._async.scenes import AsyncScene
from fvs_client._async.snapshots import AsyncSnapshot
from fvs_client._sync.client import Client
from fvs_client._sync.jobs import Job
from fvs_client._sync.rankings import Ranking
from fvs_client._sync.scenes import Scene
from fvs_client._sync.snapshots import Snapshot
from fvs_client.downloads import DownloadProgress
from fvs_client.errors import (
    AnswerTimeoutError,
    ApiError,
    ConflictError,
    ConnectionFailedError,
    DamagedDownloadError,
    DeadlineExceededError,
    DigestMismatchError,
    FieldError,
    ForbiddenError,
    FvsError,
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
    ServiceFailedError,
    UnauthenticatedError,
    UnavailableError,
    UnexpectedAnswerError,
    WaitTimeoutError,
)
from fvs_client.models.events import Event, EventKind
from fvs_client.models.images import DigestAnswer, Image, ImageMetadata, Prior, Registration, Verdict
from fvs_client.models.jobs import JobFailure, JobKind, JobState
from fvs_client.models.poses import FramePose, VehiclePose
from fvs_client.models.rankings import (
    AroundCurrent,
    Candidate,
    CandidateStatus,
    Dataset,
    Generator,
    Grid,
    Orbit,
    Pose,
    RankedCandidate,
    RankingRequest,
)
from fvs_client.models.scenes import (
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
    Trigger,
    World,
)
from fvs_client.models.service import Capabilities, Health, Limits
from fvs_client.models.snapshots import (
    Artifact,
    PinholeIntrinsics,
    SnapshotCameras,
    SnapshotMetrics,
    SnapshotView,
)
from fvs_client.retries import NO_RETRIES, Retries
from fvs_client.uploads import Outcome, UploadedFile, UploadProgress, UploadReport

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
    "AsyncRanking",
    "AsyncScene",
    "AsyncSnapshot",
    "AutomaticWorld",
    "CameraPrior",
    "Candidate",
    "CandidateStatus",
    "Capabilities",
    "Client",
    "ConflictError",
    "ConnectionFailedError",
    "DamagedDownloadError",
    "Dataset",
    "DeadlineExceededError",
    "DigestAnswer",
    "DigestMismatchError",
    "DownloadProgress",
    "EnuWorld",
    "Event",
    "EventKind",
    "FieldError",
    "ForbiddenError",
    "FramePose",
    "FvsError",
    "Generator",
    "Grid",
    "Health",
    "IdempotencyKeyReusedError",
    "Image",
    "ImageCounts",
    "ImageMetadata",
    "InvalidRequestError",
    "Job",
    "JobCanceledError",
    "JobError",
    "JobFailedError",
    "JobFailure",
    "JobKind",
    "JobState",
    "LimitExceededError",
    "Limits",
    "LocalWorld",
    "MalformedRequestError",
    "NoSnapshotError",
    "NotFoundError",
    "Orbit",
    "Origin",
    "OutOfSpaceError",
    "Outcome",
    "PayloadTooLargeError",
    "PinholeIntrinsics",
    "Policy",
    "Pose",
    "Prior",
    "RankedCandidate",
    "Ranking",
    "RankingRequest",
    "Registration",
    "Retries",
    "Scene",
    "ServiceFailedError",
    "Snapshot",
    "SnapshotCameras",
    "SnapshotMetrics",
    "SnapshotView",
    "Trigger",
    "UnauthenticatedError",
    "UnavailableError",
    "UnexpectedAnswerError",
    "UploadProgress",
    "UploadReport",
    "UploadedFile",
    "VehiclePose",
    "Verdict",
    "WaitTimeoutError",
    "World",
]
