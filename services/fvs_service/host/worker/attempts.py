"""An attempt at a job, from a start to its outcome: the runner computes, snapshots are committed once."""

import contextlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import structlog

from fvs_engine.errors import EngineError
from fvs_engine.export.points_ply import read_positions
from fvs_engine.files.atomic import write_text_atomically
from fvs_schema.artifacts import ALIGNMENT, POINTS, TERRAIN
from fvs_schema.images import Image
from fvs_schema.jobs import Job, JobFailure, JobKind
from fvs_schema.snapshots import SnapshotAlignment
from fvs_schema.stages import Stage
from fvs_service.application import Storage
from fvs_service.engine_errors import for_clients
from fvs_service.errors import OutOfSpaceError, ServiceError, StaleLeaseError, StorageUnavailableError
from fvs_service.host.protocol.messages import JobOutcome, RunJob
from fvs_service.host.worker.conversation import Conversation, StageSpans
from fvs_service.host.worker.leased_scenes import LeasedScene, LeasedScenes
from fvs_service.host.worker.outcomes import Canceled, Failed, LeftToAnother, Outcome, Paused, Succeeded
from fvs_service.host.worker.progress import JobProgress, size_of
from fvs_service.host.worker.resources import Room
from fvs_service.host.worker.stop import JobStop
from fvs_service.host.worker.taken_videos import TakenVideos
from fvs_service.host.worker.working_copies import WorkingCopies
from fvs_service.images.files import reason_of
from fvs_service.images.repository import usable_images
from fvs_service.jobs.ledger import Ledger
from fvs_service.jobs.repository import images_milestone
from fvs_service.jobs.timing import TIMING, past_timings
from fvs_service.scenes.lease import Lease
from fvs_service.scenes.repository import control_points_of, find_scene, set_working_bytes
from fvs_service.snapshots.georeferencing import align, ground_of, takeoff_altitude
from fvs_service.snapshots.service import NewSnapshot

_log = structlog.get_logger()


class Attempts:
    """Runs attempts from a start to its outcome, which is recorded in the database."""

    def __init__(self, storage: Storage, scenes: LeasedScenes, room: Room, *, trains: bool) -> None:
        self._storage = storage
        self._scenes = scenes
        self._room = room
        self._trains = trains
        self._copies = WorkingCopies(storage)

    def start(self, scene: LeasedScene, job: Job, traceparent: str | None = None) -> Outcome:
        """Run an attempt, as a span below the one of the request that queued it.

        Raises what ends the runner with the attempt: ``RunnerGoneError``, ``StaleLeaseError``,
        ``OutOfSpaceError`` and ``StorageUnavailableError``.
        """
        _log.info("job started", job=job.id, scene=job.scene_id, kind=job.kind.value, attempt=job.attempt)
        with self._storage.tracing.span(
            f"job: {job.kind.value}",
            {"fvs.job_id": job.id, "fvs.scene_id": job.scene_id, "fvs.attempt": job.attempt},
            kind="CONSUMER",
            parent=traceparent,
        ) as span:
            try:
                outcome = self._outcome(scene, job)
            except BaseException:
                self._scenes.drop(scene)  # its runner may still compute
                raise
            if isinstance(outcome, Failed):
                span.fail(outcome.error.code)
            self._record(scene.lease, job, outcome)
        return outcome

    def _outcome(self, scene: LeasedScene, job: Job) -> Outcome:
        try:
            return self._compute_and_commit(scene, job)
        except (StaleLeaseError, OutOfSpaceError, StorageUnavailableError):
            raise
        except (ServiceError, EngineError) as error:
            retryable = not isinstance(error, ServiceError) or error.retryable
            message, hint = for_clients(error, self._storage.settings.root)
            return Failed(
                JobFailure(
                    code=error.code,
                    message=message,
                    hint=hint,
                    retryable=retryable,
                    stage=Stage.SNAPSHOT,
                )
            )

    def _record(self, lease: Lease, job: Job, outcome: Outcome) -> None:
        """Store what another machine continues from, and record the attempt's end."""
        match outcome:
            case Succeeded(superseded=True) | LeftToAnother() | Paused(obstacle=None):
                self._copies.store(lease)
        match outcome:
            case LeftToAnother(work):
                self._storage.ledger.needs(lease, job.id, work)
            case Succeeded() | Failed() | Canceled():
                record_end(self._storage.ledger, lease, job, outcome)
                folder = self._storage.settings.scenes / job.scene_id
                shutil.rmtree(folder / "outcome" / job.id, ignore_errors=True)
                with self._storage.database.writing() as session:
                    set_working_bytes(session, job.scene_id, _size_bytes(folder))

    def _compute_and_commit(self, leased: LeasedScene, job: Job) -> Outcome:
        """Compute and commit what no earlier start has committed."""
        if job.kind is JobKind.FRAMES:
            return self._take_frames(leased, job)
        if self._storage.ledger.milestone(job.id, Stage.SNAPSHOT) is not None:
            return Succeeded()
        images = self._images_of(leased, job)
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
            control = control_points_of(session, job.scene_id)
        request = RunJob(
            job_id=job.id,
            request=job.request,
            images=images,
            camera=scene.camera,
            origin=scene.origin,
            control=control,
            snapshot_id=scene.snapshot_id,
            trains=self._trains,
        )
        progress = self._progress(job, images, first=scene.snapshot_id is None)
        with StageSpans(self._storage.tracing) as spans:
            spans.came_to(Stage.RESTORE)
            self._copies.restore(job.scene_id)
            made = Conversation(
                self._storage,
                leased,
                job,
                request,
                JobStop(self._storage, self._room, leased, job),
                progress,
                spans,
                lambda milestone, made: self._commit(leased.lease, job, milestone, made, images),
                lambda: self._scenes.stopping,
            ).hold()
            if isinstance(made, Failed):
                spans.span.fail(made.error.code)
            if not isinstance(made, JobOutcome):
                return made
            spans.came_to(Stage.COMMIT)
            self._copies.store(leased.lease)
            self._commit(leased.lease, job, Stage.SNAPSHOT, made, images)
        self._record_timing(leased, job, progress)
        return Succeeded()

    def _take_frames(self, leased: LeasedScene, job: Job) -> Outcome:
        """Make images from the frames of the videos that wait; those of an earlier start are done."""
        with (
            TakenVideos(self._storage, leased.lease, job) as videos,
            StageSpans(self._storage.tracing) as spans,
        ):
            request = videos.request()
            progress = self._progress(job, request.videos, first=False)
            outcome = Conversation(
                self._storage,
                leased,
                job,
                request,
                JobStop(self._storage, self._room, leased, job),
                progress,
                spans,
                lambda _milestone, _made: None,
                lambda: self._scenes.stopping,
                videos,
            ).hold()
        assert not isinstance(outcome, JobOutcome)
        if isinstance(outcome, Succeeded):
            self._record_timing(leased, job, progress)
        return outcome

    def _record_timing(self, leased: LeasedScene, job: Job, progress: JobProgress) -> None:
        timing = progress.finished()
        if timing is not None:
            document = timing.model_dump(mode="json")
            self._storage.ledger.commit_milestone(leased.lease, job.id, TIMING, document)

    def _images_of(self, scene: LeasedScene, job: Job) -> tuple[Image, ...]:
        """The images that had arrived when the attempt first started; all its starts use them."""
        with self._storage.database.reading() as session:
            images = usable_images(session, job.scene_id)
        last = max((image.number for image in images), default=0)
        milestone = images_milestone(job.attempt)
        kept = self._storage.ledger.milestone(job.id, milestone)
        if kept is None:
            kept = {"last_number": last}
            self._storage.ledger.commit_milestone(scene.lease, job.id, milestone, kept)
        return tuple(image for image in images if image.number <= kept["last_number"])

    def _progress(self, job: Job, images: tuple[Image, ...], *, first: bool) -> JobProgress:
        size = size_of(job, images, first, self._storage.settings.worker)
        with self._storage.database.reading() as session:
            past = past_timings(session, job.kind, first)
        return JobProgress(job.kind, size, past, resumed=job.progress > 0)

    def _commit(
        self, lease: Lease, job: Job, milestone: str, made: JobOutcome, images: Sequence[Image]
    ) -> None:
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        by_digest = {image.digest: image for image in images}
        if made.control is not None:
            alignment = made.control.alignment
        else:
            ignored = made.positions_ignored
            alignment = align(scene, by_digest, made.model_from_camera, positions_ignored=ignored)
        folder = Path(made.folder)
        placed = SnapshotAlignment(origin=scene.origin, **alignment.model_dump())
        takeoff = {"takeoff_altitude_m": takeoff_altitude(by_digest, made.model_from_camera, placed)}
        alignment, placed = alignment.model_copy(update=takeoff), placed.model_copy(update=takeoff)
        write_text_atomically(folder / ALIGNMENT, placed.model_dump_json(indent=1))
        files = [*made.files, ALIGNMENT]
        ground = ground_of(read_positions(folder / POINTS), placed)
        if ground is not None:
            write_text_atomically(folder / TERRAIN, ground.model_dump_json())
            files.append(TERRAIN)
        updating = job.kind is JobKind.UPDATE
        reasons, root = made.unregistered if updating else {}, self._storage.settings.root
        snapshot = NewSnapshot(
            metrics=made.metrics,
            alignment=alignment,
            control=None if made.control is None else made.control.residuals,
            files={name: folder / name for name in files},
            registered=tuple(made.model_from_camera) if updating else (),
            unregistered={
                digest: None if why is None else reason_of(why, root) for digest, why in reasons.items()
            },
        )
        self._storage.snapshots.commit(lease, job, milestone, snapshot)


def record_end(ledger: Ledger, lease: Lease, job: Job, outcome: Succeeded | Failed | Canceled) -> None:
    """Record the end of a started attempt; raises ``StaleLeaseError``."""
    match outcome:
        case Succeeded():
            ledger.succeed(lease, job.id)
        case Failed(error):
            at = job.stage if error.stage is None else error.stage
            ledger.fail(lease, job.id, error.model_copy(update={"stage": at}))
        case Canceled():
            ledger.cancel(lease, job.id)


def _size_bytes(folder: Path) -> int:
    """The size of all files in a folder; those that vanish meanwhile do not count."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                total += Path(parent, name).lstat().st_size
    return total
