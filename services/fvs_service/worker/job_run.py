"""One try of a job: its scene's runner computes, and the snapshot is committed once."""

import contextlib
import os
import queue
import shutil
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import structlog

from fvs_engine.errors import EngineError, ProcessDiedError
from fvs_engine.files.atomic import write_text_atomically
from fvs_service.application import Storage
from fvs_service.errors import ServiceError, StaleLeaseError
from fvs_service.images.model import Image
from fvs_service.images.repository import accepted_images
from fvs_service.images.service import with_original_names
from fvs_service.jobs.model import Job, JobError, JobKind
from fvs_service.jobs.repository import images_stage
from fvs_service.scenes.repository import find_scene, set_working_bytes
from fvs_service.snapshots.georeferencing import align
from fvs_service.snapshots.service import NewSnapshot
from fvs_service.worker.leased_scenes import LeasedScene, LeasedScenes
from fvs_service.worker.progress import JobProgress
from fvs_service.worker.protocol.connection import (
    RunnerError,
    RunnerGoneError,
    call,
    connect,
    exchange,
)
from fvs_service.worker.protocol.messages import CancelJob, Failure, JobOutcome, RunJob, StageProgress
from fvs_service.worker.scene_slots import SceneSlots

ALIGNMENT = "alignment.json"
"""The artifact with the snapshot's ``Alignment``."""

_SNAPSHOT_STAGE = "snapshot"
_POLL_S = 0.2
_CONNECT_S = 5.0
_STOP_S = 1.0
"""A runner that does not stop its job within this time is killed. With the polling it stays under 2 s."""

_log = structlog.get_logger()


class JobPausedError(Exception):
    """The job continues later: an update of the scene goes first."""


class ChildDiedError(Exception):
    """The SfM child died under the runner: its stage starts again."""


class _CanceledError(Exception):
    """The job was canceled."""


class _JobFailedError(Exception):
    """The job failed for a reason of its own: another try would fail too."""

    def __init__(self, failure: Failure, stage: str | None) -> None:
        super().__init__(failure.message)
        self.error = JobError(**failure.model_dump(exclude={"retry_after_s"}), stage=stage)


class JobRuns:
    """Runs jobs from their start to their end in the database."""

    def __init__(self, storage: Storage, scenes: LeasedScenes, slots: SceneSlots) -> None:
        self._storage = storage
        self._scenes = scenes
        self._slots = slots

    def run(self, scene: LeasedScene, job: Job) -> None:
        """Run a started job and record its end.

        Raises ``JobPausedError``, ``ChildDiedError``, ``RunnerGoneError`` and ``StaleLeaseError`` when it has
        not ended.
        """
        _log.info("job started", job=job.id, kind=job.kind.value, attempt=job.attempt)
        ledger = self._storage.ledger
        try:
            self._compute_and_commit(scene, job)
        except _CanceledError:
            ledger.cancel(scene.lease, job.id)
        except _JobFailedError as failed:
            ledger.fail(scene.lease, job.id, failed.error)
        except StaleLeaseError:
            self._scenes.drop(scene)
            raise
        except ChildDiedError:
            raise  # the runner itself lives, and keeps its model
        except JobPausedError:
            if not self._slots.update_waits(job.scene_id):  # the update is another worker's
                self._scenes.drop(scene)
            raise
        except (ServiceError, EngineError) as error:
            failure = JobError(
                code=error.code,
                message=error.message,
                hint=error.hint,
                retryable=not isinstance(error, ServiceError) or error.retryable,
                stage=_SNAPSHOT_STAGE,
            )
            ledger.fail(scene.lease, job.id, failure)
        except BaseException:
            self._scenes.drop(scene)  # its runner may still compute for this try
            raise
        else:
            ledger.succeed(scene.lease, job.id)
        folder = self._storage.settings.scenes / job.scene_id
        shutil.rmtree(folder / "outcome" / job.id, ignore_errors=True)
        with self._storage.database.writing() as session:
            set_working_bytes(session, job.scene_id, _size_bytes(folder))
        _log.info("job ended", job=job.id)

    def _compute_and_commit(self, leased: LeasedScene, job: Job) -> None:
        """Do what no earlier try has committed."""
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
        )
        outcome = self._compute(leased, job, request)
        self._commit(leased, job, outcome, {image.digest: image for image in images})

    def _images_of(self, scene: LeasedScene, job: Job) -> tuple[Image, ...]:
        """The images that had arrived when the attempt started: every try of it uses the same."""
        with self._storage.database.reading() as session:
            images = accepted_images(session, job.scene_id)
        last = max((image.number for image in images), default=0)
        stage = images_stage(job.attempt)
        kept = self._storage.ledger.stage(job.id, stage)
        if kept is None:
            kept = {"last_number": last}
            self._storage.ledger.commit_stage(scene.lease, job.id, stage, kept)
        return tuple(image for image in images if image.number <= kept["last_number"])

    def _compute(self, scene: LeasedScene, job: Job, request: RunJob) -> JobOutcome:
        """Have the runner run the job; records its progress and warnings, and cancels or pauses it."""
        responses = _Responses(scene.endpoint, request)
        progress = JobProgress(job.kind)
        stage: str | None = None
        stop: type[_CanceledError] | type[JobPausedError] | None = None
        stop_requested = 0.0
        wanted = False
        while True:
            document = responses.next(_POLL_S)
            if stop is None or stop is JobPausedError:
                if self._storage.ledger.cancel_requested(job.id):
                    stop = _CanceledError
                elif job.kind is JobKind.FINE and (wanted or self._slots.update_waits(job.scene_id)):
                    stop = JobPausedError
                if stop is not None and not stop_requested:
                    stop_requested = time.monotonic()
                    _request_stop(scene.endpoint)
            if stop is not None and time.monotonic() - stop_requested > _STOP_S:
                scene.child.kill()  # the lease stays, so that the job's end can be recorded
                raise stop
            match document:
                case None:
                    continue
                case {"wanted": _}:
                    wanted = True
                case {"progress": dict(reported)}:
                    found = StageProgress.model_validate(reported)
                    stage, eta_s = found.stage, progress.add(found)
                    self._storage.ledger.report(scene.lease, job.id, stage, progress.reached, eta_s)
                case {"warning": str(sentence)}:
                    named = with_original_names(sentence, request.images)
                    self._storage.ledger.warn(scene.lease, job.id, named)
                case {"result": dict(outcome)}:
                    return JobOutcome.model_validate(outcome)
                case Failure():
                    if stop is not None and document.code in ("cancelled", ProcessDiedError.code):
                        raise stop
                    if self._scenes.stopping:
                        raise RunnerGoneError(document.message)  # the next worker continues
                    if document.code == ProcessDiedError.code:
                        raise ChildDiedError(document.message)
                    named = with_original_names(document.message, request.images)
                    raise _JobFailedError(document.model_copy(update={"message": named}), stage)
                case _:
                    raise stop or RunnerGoneError("The runner died.")

    def _commit(
        self, leased: LeasedScene, job: Job, outcome: JobOutcome, images: Mapping[str, Image]
    ) -> None:
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        alignment = align(scene, images, outcome.model_from_camera)
        folder = Path(outcome.folder)
        write_text_atomically(folder / ALIGNMENT, alignment.model_dump_json(indent=1))
        updating = job.kind is JobKind.UPDATE
        made = NewSnapshot(
            metrics=outcome.metrics,
            alignment=alignment,
            files={name: folder / name for name in (*outcome.files, ALIGNMENT)},
            registered=tuple(outcome.model_from_camera) if updating else (),
            unregistered=outcome.unregistered if updating else (),
        )
        self._storage.snapshots.commit(leased.lease, job, _SNAPSHOT_STAGE, made)


class _Responses:
    """What a runner sends back for a job, read by a thread into a queue."""

    def __init__(self, endpoint: str, request: RunJob) -> None:
        self._connection = connect(endpoint, _CONNECT_S)
        self._connection.set_timeout(None)
        self._received: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._receive, args=(request,), daemon=True).start()

    def next(self, timeout_s: float) -> Any:
        """The next document, a ``Failure``, a ``RunnerGoneError``; None when there is none in time."""
        try:
            return self._received.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def _receive(self, request: RunJob) -> None:
        try:
            for document in exchange(self._connection, request):
                self._received.put(document)
        except RunnerError as error:
            self._received.put(error.failure)
        except RunnerGoneError as error:
            self._received.put(error)
        finally:
            self._connection.close()


def _size_bytes(folder: Path) -> int:
    """The size of all files in a folder; those that vanish meanwhile do not count."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                total += Path(parent, name).lstat().st_size
    return total


def _request_stop(endpoint: str) -> None:
    with contextlib.suppress(RunnerGoneError, RunnerError):  # a runner that does not stop is killed
        call(endpoint, CancelJob(), _STOP_S)
