"""One try of a job: its scene's runner computes, and the snapshot is committed once."""

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import structlog

from fvs_engine.errors import Cancelled, EngineError, NoProcessError, ProcessDiedError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.files.storage import DiskFullError
from fvs_schema.images import Image
from fvs_schema.jobs import Job, JobFailure, JobKind, WaitReason
from fvs_schema.stages import Stage
from fvs_service.application import Storage
from fvs_service.errors import OutOfSpaceError, ServiceError, StaleLeaseError, StorageUnavailableError
from fvs_service.host.protocol.connection import RunnerGoneError
from fvs_service.host.protocol.messages import Failure, JobOutcome, RunJob, StageProgress
from fvs_service.host.worker.job_responses import JobResponses
from fvs_service.host.worker.job_stop import CanceledError, JobPausedError, JobStop, SupersededError
from fvs_service.host.worker.leased_scenes import LeasedScene, LeasedScenes
from fvs_service.host.worker.progress import JobProgress, RemainingTime, size_of
from fvs_service.host.worker.room import Room
from fvs_service.host.worker.stage_spans import StageSpans
from fvs_service.host.worker.working_copies import WorkingCopies
from fvs_service.images.exclusion import quarantine
from fvs_service.images.files import with_original_names
from fvs_service.images.repository import usable_images
from fvs_service.jobs.repository import images_stage
from fvs_service.jobs.timing import TIMING_STAGE, past_timings
from fvs_service.jobs.work import Work, work_of
from fvs_service.scenes.repository import find_scene, set_working_bytes
from fvs_service.snapshots.artifacts import ALIGNMENT
from fvs_service.snapshots.georeferencing import align
from fvs_service.snapshots.service import NewSnapshot
from fvs_service.tracing import Span

_SNAPSHOT_STAGE = Stage.SNAPSHOT
_POLL_S = 0.2
_REPORT_EVERY_S = 2.0
"""The remaining time is also reported in a stage that reports no progress for this long."""

_log = structlog.get_logger()


class ChildDiedError(Exception):
    """The SfM child died under the runner: its stage starts again."""


class _JobFailedError(Exception):
    """The job failed for a reason of its own: another try would fail too."""

    def __init__(self, failure: Failure, stage: Stage | None) -> None:
        super().__init__(failure.message)
        self.error = JobFailure(**failure.model_dump(exclude={"retry_after_s"}), stage=stage)


class JobRuns:
    """Runs jobs from their start to their end in the database."""

    def __init__(self, storage: Storage, scenes: LeasedScenes, room: Room) -> None:
        self._storage = storage
        self._scenes = scenes
        self._room = room
        self._copies = WorkingCopies(storage)

    def run(self, scene: LeasedScene, job: Job, traceparent: str | None = None) -> None:
        """Run a started job and record its end, as a span below the one of the request that queued it.

        Raises ``JobPausedError``, ``ChildDiedError``, ``RunnerGoneError`` and ``StaleLeaseError`` when it has
        not ended.
        """
        _log.info("job started", job=job.id, scene=job.scene_id, kind=job.kind.value, attempt=job.attempt)
        with self._storage.tracing.span(
            f"job: {job.kind.value}",
            {"fvs.job_id": job.id, "fvs.scene_id": job.scene_id, "fvs.attempt": job.attempt},
            kind="CONSUMER",
            parent=traceparent,
            expected=(JobPausedError,),
        ) as span:
            self._run(scene, job, span)

    def _run(self, scene: LeasedScene, job: Job, span: Span) -> None:
        ledger = self._storage.ledger
        try:
            self._compute_and_commit(scene, job)
        except CanceledError:
            ledger.cancel(scene.lease, job.id)
        except _JobFailedError as failed:
            span.fail(failed.error.code)
            ledger.fail(scene.lease, job.id, failed.error)
        except StaleLeaseError:
            self._scenes.drop(scene)
            raise
        except ChildDiedError:
            raise  # the runner itself is alive, and keeps its model
        except JobPausedError as paused:
            if paused.obstacle is None:
                self._copies.store(scene.lease)  # another machine may continue
            if paused.needs is not None:
                ledger.needs(scene.lease, job.id, paused.needs)
            raise
        except (OutOfSpaceError, StorageUnavailableError):
            self._scenes.drop(scene)
            raise
        except (ServiceError, EngineError) as error:
            failure = JobFailure(
                code=error.code,
                message=error.message,
                hint=error.hint,
                retryable=not isinstance(error, ServiceError) or error.retryable,
                stage=_SNAPSHOT_STAGE,
            )
            span.fail(failure.code)
            ledger.fail(scene.lease, job.id, failure)
        except SupersededError:
            self._copies.store(scene.lease)  # another machine may run the next update
            ledger.succeed(scene.lease, job.id)
        except BaseException:
            self._scenes.drop(scene)  # its runner may still compute for this try
            raise
        else:
            ledger.succeed(scene.lease, job.id)
        folder = self._storage.settings.scenes / job.scene_id
        shutil.rmtree(folder / "outcome" / job.id, ignore_errors=True)
        with self._storage.database.writing() as session:
            set_working_bytes(session, job.scene_id, _size_bytes(folder))

    def _compute_and_commit(self, leased: LeasedScene, job: Job) -> None:
        """Run and commit the stages that no earlier try has committed."""
        if self._storage.ledger.stage(job.id, _SNAPSHOT_STAGE) is not None:
            return
        images = self._images_of(leased, job)
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        request = RunJob(
            job_id=job.id,
            request=job.request,
            images=images,
            camera=scene.camera,
            origin=scene.origin,
            snapshot_id=scene.snapshot_id,
            trains=Work.TRAINING in work_of(self._storage.settings.worker.work),
        )
        remaining = self._remaining_time(job, images, first=scene.snapshot_id is None)
        with StageSpans(
            self._storage.tracing, expected=(JobPausedError, CanceledError, SupersededError)
        ) as spans:
            spans.came_to(Stage.RESTORE)
            self._copies.restore(job.scene_id)
            outcome = self._compute(leased, job, request, remaining, spans)
            spans.came_to(Stage.COMMIT)
            self._copies.store(leased.lease)
            self._commit(leased, job, _SNAPSHOT_STAGE, outcome, images)
        timing = remaining.finished()
        if timing is not None:
            self._storage.ledger.commit_stage(leased.lease, job.id, TIMING_STAGE, timing.model_dump())

    def _images_of(self, scene: LeasedScene, job: Job) -> tuple[Image, ...]:
        """The images that had arrived when the attempt started: every try of it uses the same."""
        with self._storage.database.reading() as session:
            images = usable_images(session, job.scene_id)
        last = max((image.number for image in images), default=0)
        stage = images_stage(job.attempt)
        kept = self._storage.ledger.stage(job.id, stage)
        if kept is None:
            kept = {"last_number": last}
            self._storage.ledger.commit_stage(scene.lease, job.id, stage, kept)
        return tuple(image for image in images if image.number <= kept["last_number"])

    def _remaining_time(self, job: Job, images: tuple[Image, ...], *, first: bool) -> RemainingTime:
        size = size_of(job, images, first, self._storage.settings.worker)
        with self._storage.database.reading() as session:
            past = past_timings(session, job.kind, first)
        return RemainingTime(job.kind, size, past, resumed=job.progress > 0)

    def _compute(
        self,
        scene: LeasedScene,
        job: Job,
        request: RunJob,
        remaining: RemainingTime,
        spans: StageSpans,
    ) -> JobOutcome:
        """Have the runner run the job; records its progress and warnings, and cancels or pauses it."""
        responses = JobResponses(scene.endpoint, request)
        progress = JobProgress(job.kind)
        stop = JobStop(self._storage, self._room, scene, job)
        stage: Stage | None = None
        reported = time.monotonic()
        while True:
            document = responses.next(_POLL_S)
            match document:
                case {"progress": dict(stage_progress)}:
                    found = StageProgress.model_validate(stage_progress)
                    progress.add(found)
                    spans.came_to(found.stage)
                    eta_s, reported = remaining.add(found), time.monotonic()
                    with contextlib.suppress(StorageUnavailableError):  # the next report has it all
                        self._storage.ledger.report(scene.lease, job.id, found.stage, progress.reached, eta_s)
                    stop.came_to(progress.reached, new_stage=found.stage != stage, stage=found.stage)
                    stage = found.stage
                case {"first": dict(outcome)} | {"quick": dict(outcome)}:
                    (name,) = document
                    made, at = JobOutcome.model_validate(outcome), f"{name}-snapshot-{job.attempt}"
                    _patiently(scene, lambda: self._commit(scene, job, at, made, request.images))  # noqa: B023
                    stop.may_be_superseded = name == "quick"  # the first model is of few images
                case {"quarantined": dict(reasons)}:
                    _patiently(scene, lambda: self._quarantine(scene, reasons, request.images))
                case {"warning": str(sentence)}:
                    named = with_original_names(sentence, request.images)
                    _patiently(scene, lambda: self._storage.ledger.warn(scene.lease, job.id, named))  # noqa: B023
                case {"result": dict(outcome)}:
                    remaining.add(StageProgress(stage=Stage.COMMIT, share=None))
                    return JobOutcome.model_validate(outcome)
                case {"result": None}:
                    raise JobPausedError(needs=Work.TRAINING)
                case Failure():
                    raise self._end_of(document, stop, stage, request)
                case None:
                    if stage is not None and time.monotonic() - reported > _REPORT_EVERY_S:
                        eta_s, reported = remaining.now(), time.monotonic()
                        with contextlib.suppress(StorageUnavailableError):
                            self._storage.ledger.report(scene.lease, job.id, stage, progress.reached, eta_s)
                case _:
                    raise stop.reason or RunnerGoneError("The runner died.")
            with contextlib.suppress(StorageUnavailableError):
                stop.check()

    def _end_of(self, failure: Failure, stop: JobStop, stage: Stage | None, request: RunJob) -> Exception:
        """The error that ends the job's turn after a runner's failure."""
        if stop.reason is not None and failure.code in (Cancelled.code, ProcessDiedError.code):
            return stop.reason
        if self._scenes.stopping:
            return RunnerGoneError(failure.message)  # the next worker continues
        if failure.code == StorageUnavailableError.code:
            return StorageUnavailableError(failure.message, hint=failure.hint)
        if failure.code in (DiskFullError.code, OutOfSpaceError.code):
            return JobPausedError(WaitReason.DISK)
        if failure.code in (ProcessDiedError.code, NoProcessError.code):
            return ChildDiedError(failure.message)
        named = with_original_names(failure.message, request.images)
        return _JobFailedError(failure.model_copy(update={"message": named}), stage)

    def _quarantine(self, scene: LeasedScene, reasons: Mapping[str, str], images: tuple[Image, ...]) -> None:
        named = {digest: with_original_names(reason, images) for digest, reason in reasons.items()}
        with self._storage.database.writing(scene.lease.scene_id) as session:
            quarantine(session, scene.lease, named)

    def _commit(
        self, leased: LeasedScene, job: Job, stage: str, outcome: JobOutcome, images: Sequence[Image]
    ) -> None:
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        by_digest = {image.digest: image for image in images}
        alignment = align(
            scene, by_digest, outcome.model_from_camera, positions_ignored=outcome.positions_ignored
        )
        folder = Path(outcome.folder)
        write_text_atomically(folder / ALIGNMENT, alignment.model_dump_json(indent=1))
        updating = job.kind is JobKind.UPDATE
        made = NewSnapshot(
            metrics=outcome.metrics,
            alignment=alignment,
            files={name: folder / name for name in (*outcome.files, ALIGNMENT)},
            registered=tuple(outcome.model_from_camera) if updating else (),
            unregistered={
                digest: with_original_names(reason, images) for digest, reason in outcome.unregistered.items()
            }
            if updating
            else {},
        )
        self._storage.snapshots.commit(leased.lease, job, stage, made)


def _patiently(scene: LeasedScene, write: Callable[[], object]) -> None:
    """Write to the database; waits while it cannot be reached, as long as the runner has its lease."""
    while True:
        try:
            write()
        except StorageUnavailableError:
            if not scene.child.alive:
                raise
            time.sleep(_POLL_S)
        else:
            return


def _size_bytes(folder: Path) -> int:
    """The size of all files in a folder; those that vanish meanwhile do not count."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                total += Path(parent, name).lstat().st_size
    return total
