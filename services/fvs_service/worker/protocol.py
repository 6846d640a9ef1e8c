"""What a runner is asked, and how it answers: one JSON document per line over TCP.

A connection carries one question at a time. The first line names the runner's secret; every answer is a line
with ``result`` or ``error``. Before it a job sends lines with ``progress``, with ``warning``, and with
``wanted`` when another worker would like to have the scene.
"""

import json
import socket
import threading
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from fvs_engine.errors import EngineError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_service.errors import (
    InternalError,
    InvalidRequestError,
    NotFoundError,
    OutOfSpaceError,
    ServiceError,
    UnavailableError,
    from_engine,
)
from fvs_service.images.model import Image
from fvs_service.jobs.model import JobRequest
from fvs_service.rankings.port import DrawView, Picture, RankViews, RunnerView
from fvs_service.scenes.model import CameraPrior, Origin
from fvs_service.snapshots.model import SnapshotMetrics

MAX_LINE_BYTES = 64_000_000


class Message(BaseModel):
    """Base of all messages."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ViewMessage(Message):
    """A view; ``camera`` is width, height, fx, fy, cx, cy, and ``camera_from_model`` a matrix [3, 4]."""

    id: str
    camera: tuple[int, int, float, float, float, float]
    camera_from_model: tuple[tuple[float, float, float, float], ...]
    distance_m: float | None

    @classmethod
    def of(cls, view: RunnerView) -> "ViewMessage":
        """The message of a view."""
        camera, matrix = view.camera, view.camera_from_model.matrix[:3].tolist()
        return cls(
            id=view.id,
            camera=(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy),
            camera_from_model=tuple(tuple(row) for row in matrix),
            distance_m=view.distance_m,
        )

    def view(self) -> RunnerView:
        """The view again."""
        transform = RigidTransform.from_matrix(self.camera_from_model)
        return RunnerView(self.id, PinholeCamera(*self.camera), transform, self.distance_m)


class RankQuestion(Message):
    """See ``RankViews``."""

    kind: Literal["rank"] = "rank"
    snapshot_id: str
    pinned: bool
    method: str
    budget: int
    seed: int
    views: tuple[ViewMessage, ...]

    @classmethod
    def of(cls, request: RankViews) -> "RankQuestion":
        """The message of a request."""
        return cls(
            snapshot_id=request.snapshot_id,
            pinned=request.pinned,
            method=request.method,
            budget=request.budget,
            seed=request.seed,
            views=tuple(ViewMessage.of(view) for view in request.views),
        )


class DrawQuestion(Message):
    """See ``DrawView``; the answer is the PNG in base 64."""

    kind: Literal["draw"] = "draw"
    snapshot_id: str
    view: ViewMessage
    picture: Picture

    @classmethod
    def of(cls, request: DrawView) -> "DrawQuestion":
        """The message of a request."""
        return cls(
            snapshot_id=request.snapshot_id, view=ViewMessage.of(request.view), picture=request.picture
        )


class JobQuestion(Message):
    """Do a job up to its files; the answer is a ``JobOutcome``.

    ``images`` are those that the scene may learn from; ``origin`` is that of the world in which they tell
    where they were taken; ``snapshot_id`` is the scene's latest snapshot, None before the first.
    """

    kind: Literal["job"] = "job"
    job_id: str
    request: JobRequest
    images: tuple[Image, ...]
    camera: CameraPrior | None
    origin: Origin | None
    snapshot_id: str | None


class CancelQuestion(Message):
    """Stop the job that is running."""

    kind: Literal["cancel"] = "cancel"


class YieldQuestion(Message):
    """End, so that another worker can have the scene; refused while a job is running."""

    kind: Literal["yield"] = "yield"


class PingQuestion(Message):
    """Are you there; the answer says for how long nobody has asked for anything else, ``{"idle_s": …}``."""

    kind: Literal["ping"] = "ping"


Question = Annotated[
    RankQuestion | DrawQuestion | JobQuestion | CancelQuestion | YieldQuestion | PingQuestion,
    Field(discriminator="kind"),
]
QUESTION: TypeAdapter[Question] = TypeAdapter(Question)


class ProgressNote(Message):
    """How far a stage is, in [0, 1] (None: not known), and how long it will still take."""

    stage: str
    share: float | None
    eta_s: float | None = None


class JobOutcome(Message):
    """What a job has made: ``files`` in ``folder``, and which images are registered.

    ``model_from_camera`` is digest → matrix [3, 4] of the images that have one; ``unregistered`` are the
    digests of all others that the job processed.
    """

    folder: str
    files: tuple[str, ...]
    model_from_camera: dict[str, tuple[tuple[float, float, float, float], ...]]
    unregistered: tuple[str, ...]
    metrics: SnapshotMetrics


class ErrorNote(Message):
    """A failure: ``code`` is the service's for questions, the engine's for jobs."""

    code: str
    message: str
    hint: str
    retryable: bool


class RunnerError(Exception):
    """A runner's answer that something failed."""

    def __init__(self, note: ErrorNote) -> None:
        super().__init__(note.message)
        self.note = note


class RunnerGoneError(Exception):
    """The runner did not answer to the end: it, or the way to it, is gone."""


class Line:
    """A connection to or from a runner, line by line."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._file = connection.makefile("rb")
        self._sending = threading.Lock()

    def send(self, document: Any) -> None:
        """Send one document; raises ``RunnerGoneError``."""
        try:
            content = json.dumps(document, separators=(",", ":")).encode() + b"\n"
            with self._sending:
                self._connection.sendall(content)
        except OSError as error:
            raise RunnerGoneError("The connection is broken.") from error

    def receive(self) -> Any:
        """The next document; raises ``RunnerGoneError`` when there is none any more."""
        try:
            line = self._file.readline(MAX_LINE_BYTES)
        except OSError as error:
            raise RunnerGoneError("The connection is broken.") from error
        if not line.endswith(b"\n"):
            raise RunnerGoneError("The other side has gone.")
        return json.loads(line)

    def wait_at_most(self, seconds: float | None) -> None:
        """Give up on sending and receiving after so long."""
        self._connection.settimeout(seconds)

    def close(self) -> None:
        """Hang up."""
        self._file.close()
        self._connection.close()


def connect(endpoint: str, timeout_s: float) -> Line:
    """Open a line to a runner; ``endpoint`` is ``host:port/secret``. Raises ``RunnerGoneError``."""
    address, secret = endpoint.split("/", 1)
    host, port = address.rsplit(":", 1)
    try:
        line = Line(socket.create_connection((host, int(port)), timeout_s))
    except OSError as error:
        raise RunnerGoneError(f"Nobody answers at {address}.") from error
    line.send({"secret": secret})
    return line


def ask(line: Line, question: BaseModel) -> Iterator[Any]:
    """Ask; yields what comes before the answer, then the answer as ``{"result": …}``.

    Raises ``RunnerError`` when the answer is a failure, ``RunnerGoneError``.
    """
    line.send(question.model_dump(mode="json"))
    while True:
        document = line.receive()
        if "error" in document:
            raise RunnerError(ErrorNote.model_validate(document["error"]))
        yield document
        if "result" in document:
            return


def answer_to(line: Line, question: BaseModel) -> Any:
    """The result, for questions whose answer comes at once."""
    return next(document["result"] for document in ask(line, question) if "result" in document)


def note_of(error: Exception) -> ErrorNote:
    """What to tell of a failed question."""
    if isinstance(error, EngineError):
        error = from_engine(error)
    if isinstance(error, ServiceError):
        return ErrorNote(code=error.code, message=error.message, hint=error.hint, retryable=error.retryable)
    return ErrorNote(
        code=InternalError.code, message=f"{type(error).__name__}: {error}", hint="", retryable=True
    )


_KINDS = {kind.code: kind for kind in (InvalidRequestError, NotFoundError, OutOfSpaceError, UnavailableError)}


def error_of(note: ErrorNote) -> ServiceError:
    """The service's error for a failed question."""
    return _KINDS.get(note.code, InternalError)(note.message, hint=note.hint)
