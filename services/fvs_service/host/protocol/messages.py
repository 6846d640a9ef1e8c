"""The messages of the protocol: requests to a runner, and what it sends back.

A request is one of ``Request``. The response is an object with ``result``, which the request's class
describes, or ``error`` (a ``Failure``). Objects with ``part`` precede it: a ``JobMessage`` each while a job
runs, and lists of ``CandidateScore`` while the views of a ``RankViews`` that is ``streamed`` are scored.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from fvs_engine.errors import EngineError
from fvs_engine.geometry import RigidTransform
from fvs_engine.records import Record
from fvs_schema.control_points import ControlPoints, ControlResiduals
from fvs_schema.findings import Finding
from fvs_schema.images import Image
from fvs_schema.jobs import JobRequest
from fvs_schema.scenes import Alignment, CameraPrior, Origin
from fvs_schema.snapshots import SnapshotMetrics
from fvs_schema.stages import Stage
from fvs_service.engine_errors import from_engine
from fvs_service.errors import (
    DeadlineError,
    InternalError,
    InvalidRequestError,
    LimitExceededError,
    NotFoundError,
    OutOfSpaceError,
    ServiceError,
    UnavailableError,
)
from fvs_service.rankings.port import ForecastViews, GenerateViews, PlanViews, RankViews, RenderView
from fvs_service.settings import Settings


class RunnerOrder(Record):
    """The first line of a runner's standard input: its scene, its parent's process id, the settings.

    It listens at ``address``, a host name or IP address of its machine.
    """

    scene_id: str
    parent: int
    address: str = "127.0.0.1"
    settings: Settings


class RunJob(Record):
    """Run a job until its files are written; the result is a ``JobFinished``.

    Unless the worker ``trains``, the job ends when an update's images are registered.

    A job that takes frames has ``videos``, and the scene ``room`` for so many images more. All others have
    ``images``, those that the job may use, ``camera`` the scene's focal length prior, ``origin`` that
    of the world frame of their position priors and of its ``control`` points, ``snapshot_id`` the scene's
    latest snapshot, None before the first.
    """

    kind: Literal["job"] = "job"
    job_id: str
    request: JobRequest
    images: tuple[Image, ...]
    camera: CameraPrior | None
    origin: Origin | None
    control: ControlPoints | None = None
    snapshot_id: str | None
    trains: bool = True
    videos: tuple[Image, ...] = ()
    room: int = 0


class CancelJob(Record):
    """Stop the running job at its next step."""

    kind: Literal["cancel"] = "cancel"


class YieldScene(Record):
    """End the runner, so that another worker can take the scene; an error while a job runs."""

    kind: Literal["yield"] = "yield"


class ForgetImages(Record):
    """Forget the images that are kept in memory between jobs; refused while a job runs."""

    kind: Literal["forget-images"] = "forget-images"


class Ping(Record):
    """Return the ``RunnerStatus``."""

    kind: Literal["ping"] = "ping"


Request = Annotated[
    RankViews
    | RenderView
    | GenerateViews
    | PlanViews
    | ForecastViews
    | RunJob
    | CancelJob
    | YieldScene
    | ForgetImages
    | Ping,
    Field(discriminator="kind"),
]
REQUEST: TypeAdapter[Request] = TypeAdapter(Request)


class RunnerStarted(Record):
    """The line that a runner writes to standard output when it listens; ``backend`` is its rasteriser."""

    endpoint: str
    backend: str


class QueueStatus(Record):
    """The state of a queue: tasks that wait, tasks that are computed, and the time until all are done."""

    waiting: int
    computing: int
    expected_s: float


class RunnerStatus(Record):
    """The time since the last ranking, render or job, and the queue of rankings and renders."""

    idle_s: float
    queue: QueueStatus


class ControlOutcome(Record):
    """The alignment of a model by control points, and their residuals."""

    alignment: Alignment
    residuals: ControlResiduals


class JobOutcome(Record):
    """What a job has made: ``files`` in ``folder``, and which images are registered.

    ``model_from_camera`` has the poses of the registered images by digest; ``unregistered`` has the digests
    of all others that the job processed, with the reasons, where there are any. ``positions_ignored``: the
    images contradict the positions, so these do not align the model with the world. ``control``: what does
    instead, where there are control points that can.
    """

    folder: str
    files: tuple[str, ...]
    model_from_camera: dict[str, RigidTransform]
    unregistered: dict[str, Finding | None]
    metrics: SnapshotMetrics
    positions_ignored: bool = False
    control: ControlOutcome | None = None


class JobFinished(Record):
    """What a job has made; None when a worker that trains must continue it, and of one that takes frames."""

    outcome: JobOutcome | None


class StageProgress(Record):
    """How far a stage has come, in [0, 1] (None: unknown)."""

    kind: Literal["progress"] = "progress"
    stage: Stage
    share: float | None


class Warned(Record):
    """What the user should know about the job's result."""

    kind: Literal["warning"] = "warning"
    finding: Finding


class Quarantined(Record):
    """The digests of images that crash structure from motion, with the reasons."""

    kind: Literal["quarantined"] = "quarantined"
    reasons: dict[str, Finding]


class ModelMade(Record):
    """An intermediate model of an update: that of the first images, or the quick one of all."""

    kind: Literal["model"] = "model"
    name: Literal["first", "quick"]
    outcome: JobOutcome


class FrameTaken(Record):
    """A frame of the video with this digest: a JPEG, named after its time, for the worker to store."""

    kind: Literal["frame"] = "frame"
    video: str
    name: str
    file: str


class VideoTaken(Record):
    """All frames of a video are taken; without any, ``reason`` and ``hint`` say why it cannot be used.

    Findings name frames by their names.
    """

    kind: Literal["video"] = "video"
    video: str
    findings: tuple[Finding, ...] = ()
    reason: str = ""
    hint: str = ""


class SceneWanted(Record):
    """Another worker asks for the scene: the worker that receives this gives up the scene and its job."""

    kind: Literal["wanted"] = "wanted"


JobMessage = Annotated[
    StageProgress | Warned | Quarantined | ModelMade | FrameTaken | VideoTaken | SceneWanted,
    Field(discriminator="kind"),
]
"""What a runner sends while a job runs."""
JOB_MESSAGE: TypeAdapter[JobMessage] = TypeAdapter(JobMessage)


class Failure(Record):
    """Why a request failed; ``code`` is one of the engine's for jobs, else one of the service's."""

    code: str
    message: str
    hint: str
    retryable: bool
    retry_after_s: int | None = None


def failure_of(error: Exception, root: Path) -> Failure:
    """The message for a request that failed with ``error``; it has no details of a defect.

    Paths are relative to ``root``, the service's.
    """
    if isinstance(error, EngineError):
        error = from_engine(error, root)
    if isinstance(error, ServiceError):
        return Failure(
            code=error.code,
            message=error.message,
            hint=error.hint,
            retryable=error.retryable,
            retry_after_s=error.retry_after_s,
        )
    return Failure(
        code=InternalError.code,
        message="The service failed.",
        hint="Try again; if it fails again, report the scene's id: the log of its runner has the details.",
        retryable=True,
    )


_KINDS: dict[str, type[ServiceError]] = {
    kind.code: kind
    for kind in (
        DeadlineError,
        InvalidRequestError,
        LimitExceededError,
        NotFoundError,
        OutOfSpaceError,
        UnavailableError,
    )
}


def error_of(failure: Failure) -> ServiceError:
    """The service's error for a failed request."""
    kind = _KINDS.get(failure.code, InternalError)
    error = kind(failure.message, hint=failure.hint)
    error.retry_after_s = failure.retry_after_s
    return error
