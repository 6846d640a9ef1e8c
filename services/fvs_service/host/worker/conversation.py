"""The conversation with a runner about a job: what it reports is recorded, until there is an outcome."""

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from fvs_engine.errors import Cancelled, NoProcessError, ProcessDiedError
from fvs_engine.files.storage import DiskFullError
from fvs_schema.findings import Finding
from fvs_schema.jobs import Job, JobFailure, WaitReason
from fvs_schema.stages import Stage
from fvs_service.application import Storage
from fvs_service.errors import OutOfSpaceError, StorageUnavailableError
from fvs_service.host.protocol.connection import Connection, RunnerError, RunnerGoneError, connect, exchange
from fvs_service.host.protocol.messages import (
    JOB_MESSAGE,
    Failure,
    FrameTaken,
    JobFinished,
    JobMessage,
    JobOutcome,
    ModelMade,
    Quarantined,
    RunJob,
    SceneWanted,
    StageProgress,
    VideoTaken,
    Warned,
)
from fvs_service.host.worker.leased_scenes import LeasedScene
from fvs_service.host.worker.outcomes import (
    Failed,
    LeftToAnother,
    Outcome,
    Paused,
    StartAgain,
    Succeeded,
)
from fvs_service.host.worker.progress import JobProgress
from fvs_service.host.worker.stop import JobStop
from fvs_service.host.worker.taken_videos import TakenVideos
from fvs_service.images.exclusion import quarantine
from fvs_service.images.files import notice_of, reason_of
from fvs_service.jobs.stages import Work
from fvs_service.tracing import Span, Tracing

_CONNECT_S = 5.0
_POLL_S = 0.2
_REPORT_EVERY_S = 2.0
"""The remaining time is also reported in a stage that reports no progress for this long."""

_Received: TypeAlias = JobMessage | JobFinished | Failure | RunnerGoneError


class StageSpans(contextlib.ExitStack):
    """The span of the stage that a job is in; it ends with the stage, or with the job."""

    def __init__(self, tracing: Tracing) -> None:
        super().__init__()
        self._tracing = tracing
        self._stage: Stage | None = None
        self.span = Span()

    def came_to(self, stage: Stage) -> None:
        """Begin a stage, unless the job is in it already."""
        if stage != self._stage:
            self.close()
            self._stage = stage
            self.span = self.enter_context(self._tracing.span(f"stage: {stage}"))


@dataclass
class Conversation:
    """Records a job's progress, warnings and quarantined images, and cancels or pauses it.

    ``commit`` makes a snapshot of an update's first or quick model; ``stopping`` tells that the worker ends;
    ``videos`` stores the frames that a job takes.
    """

    storage: Storage
    scene: LeasedScene
    job: Job
    request: RunJob
    stop: JobStop
    progress: JobProgress
    spans: StageSpans
    commit: Callable[[str, JobOutcome], object]
    stopping: Callable[[], bool]
    videos: TakenVideos | None = None

    def __post_init__(self) -> None:
        self._stage: Stage | None = None
        self._reported = time.monotonic()
        self._received: queue.Queue[_Received] = queue.Queue()

    def hold(self) -> JobOutcome | Outcome:
        """Run the job on the runner; returns the runner's result, or an outcome if there is none.

        Raises ``RunnerGoneError``, ``StorageUnavailableError`` and ``StaleLeaseError``; the runner may then
        still compute.
        """
        connection = connect(self.scene.endpoint, _CONNECT_S)
        connection.set_timeout(None)
        threading.Thread(target=self._receive, args=(connection,), daemon=True).start()
        while True:
            message = None
            with contextlib.suppress(queue.Empty):
                message = self._received.get(timeout=_POLL_S)
            match message:
                case JobFinished():
                    if self.videos is not None:
                        return Succeeded()
                    if message.outcome is None:
                        return LeftToAnother(Work.TRAINING)
                    self.progress.add(StageProgress(stage=Stage.COMMIT, share=None))
                    return message.outcome
                case Failure():
                    return self._outcome_of(message)
                case RunnerGoneError() | SceneWanted():
                    if self.stop.outcome is not None:
                        return self.stop.outcome
                    if isinstance(message, RunnerGoneError):
                        raise message
                    raise RunnerGoneError("Another worker asked for the scene.")
                case None:
                    self._report_silence()
                case _:
                    self._record(message)
            with contextlib.suppress(StorageUnavailableError):
                if self.stop.check() and self.stop.outcome is not None:
                    return self.stop.outcome

    def _receive(self, connection: Connection) -> None:
        try:
            for document in exchange(connection, self.request):
                if "part" in document:
                    self._received.put(JOB_MESSAGE.validate_python(document["part"]))
                else:
                    self._received.put(JobFinished.model_validate(document["result"]))
        except RunnerError as error:
            self._received.put(error.failure)
        except (RunnerGoneError, ValueError):  # ValueError: it cannot be read
            self._received.put(RunnerGoneError("The runner died."))
        finally:
            connection.close()

    def _record(
        self, message: StageProgress | Warned | Quarantined | ModelMade | FrameTaken | VideoTaken
    ) -> None:
        lease = self.scene.lease
        match message:
            case StageProgress(stage=stage):
                self.spans.came_to(stage)
                self._report(stage, self.progress.add(message))
                self.stop.came_to(self.progress.reached, new_stage=stage != self._stage, stage=stage)
                self._stage = stage
            case ModelMade(name=name, outcome=made):
                self._patiently(lambda: self.commit(f"{name}-snapshot-{self.job.attempt}", made))
                self.stop.may_be_superseded = name == "quick"  # the first model is of few images
            case Quarantined(reasons=reasons):
                root = self.storage.settings.root
                findings = {digest: reason_of(reason, root) for digest, reason in reasons.items()}
                self._patiently(lambda: self._quarantine(findings))
            case FrameTaken() | VideoTaken():
                assert self.videos is not None
                self._patiently(partial(self.videos.record, message))
            case Warned(finding=finding):
                warning = notice_of(finding, self.request.images, self.storage.settings.root)
                self._patiently(lambda: self.storage.ledger.warn(lease, self.job.id, warning))

    def _report(self, stage: Stage, eta_s: float | None) -> None:
        self._reported = time.monotonic()
        with contextlib.suppress(StorageUnavailableError):  # the next report has it all
            self.storage.ledger.report(self.scene.lease, self.job.id, stage, self.progress.reached, eta_s)

    def _report_silence(self) -> None:
        if self._stage is not None and time.monotonic() - self._reported > _REPORT_EVERY_S:
            self._report(self._stage, self.progress.now())

    def _quarantine(self, reasons: dict[str, Finding]) -> None:
        with self.storage.database.writing(self.job.scene_id) as session:
            quarantine(session, self.scene.lease, reasons)

    def _patiently(self, write: Callable[[], object]) -> None:
        """Write to the database; while it cannot be reached, waits as long as the runner lives."""
        while True:
            try:
                write()
            except StorageUnavailableError:
                if not self.scene.child.alive:
                    raise
                time.sleep(_POLL_S)
            else:
                return

    def _outcome_of(self, failure: Failure) -> Outcome:
        """What a runner's failure means for the attempt; raises when the runner can no longer be used."""
        code = failure.code
        if self.stop.outcome is not None and code in (Cancelled.code, ProcessDiedError.code):
            return self.stop.outcome
        if self.stopping():
            raise RunnerGoneError(failure.message)  # the next worker continues
        if code == StorageUnavailableError.code:
            raise StorageUnavailableError(failure.message, hint=failure.hint)
        if code in (DiskFullError.code, OutOfSpaceError.code):
            return Paused(WaitReason.DISK)
        if code in (ProcessDiedError.code, NoProcessError.code):
            return StartAgain(failure.message)  # the runner itself is alive, and keeps its model
        return Failed(JobFailure(**failure.model_dump(exclude={"retry_after_s"}), stage=self._stage))
