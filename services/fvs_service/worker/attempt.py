"""One attempt at a job: the scene is taken, its runner works, and what it made is committed, once."""

import queue
import shutil
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError

from fvs_engine.errors import EngineError, ProcessDiedError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.geometry import RigidTransform
from fvs_service.application import Storage
from fvs_service.errors import NotFoundError, ServiceError, StaleLeaseError
from fvs_service.images.model import Image
from fvs_service.images.repository import accepted_images
from fvs_service.images.service import with_senders_names
from fvs_service.jobs.model import Job, JobError, JobKind
from fvs_service.jobs.port import JobTicket
from fvs_service.jobs.repository import find_job, images_stage
from fvs_service.scenes.repository import find_scene
from fvs_service.snapshots.georeferencing import align
from fvs_service.snapshots.service import NewSnapshot
from fvs_service.worker.capacity import job_need_bytes
from fvs_service.worker.host import Host, Hosted
from fvs_service.worker.progress import JobProgress
from fvs_service.worker.protocol import (
    CancelQuestion,
    ErrorNote,
    JobOutcome,
    JobQuestion,
    ProgressNote,
    RunnerError,
    RunnerGoneError,
    answer_to,
    ask,
    connect,
)
from fvs_service.worker.tries import Tries
from fvs_service.worker.turns import Turns

ALIGNMENT = "alignment.json"
"""The artefact with the snapshot's ``Alignment``."""

_SNAPSHOT_STAGE = "snapshot"
_POLL_S = 0.2
_CONNECT_S = 5.0
_STOP_S = 1.0
"""A runner that was asked to stop has so long; then it is killed. With the polling it stays under 2 s."""
MAX_TRIES = 6
"""So often a job may break off without coming any farther."""
_PAUSE_S = 0.5

_log = structlog.get_logger()


class _StoppedError(Exception):
    """The job was stopped on request."""


class _PausedError(Exception):
    """The job goes on later: an update of the scene goes first."""


class _ChildDiedError(Exception):
    """Structure from motion's process died under the runner: its stage is begun again."""


class _FailedError(Exception):
    """The job cannot be done, for a reason that is its own."""

    def __init__(self, note: ErrorNote, stage: str | None) -> None:
        super().__init__(note.message)
        self.error = JobError(
            code=note.code, message=note.message, hint=note.hint, retryable=note.retryable, stage=stage
        )


class Attempts:
    """Runs attempts; any thread may run one, the same one may be run again after a crash."""

    def __init__(self, storage: Storage, host: Host) -> None:
        self._storage = storage
        self._host = host
        self._turns = Turns()

    def run(self, ticket: JobTicket) -> None:
        """Bring the attempt to its end, also when processes die of it.

        One that breaks off again and again without coming any farther is given up.
        """
        tries = Tries(self._storage.settings.scenes / ticket.scene_id, ticket)
        reason = "the death of its worker"
        while not self._over(ticket):
            if self._host.stopping:
                threading.Event().wait()  # the process ends; the attempt is taken up by the next one
            try:
                if self._storage.ledger.cancel_requested(ticket.job_id):
                    self._cancel(ticket)
                elif tries.in_vain(self._progress(ticket)) >= MAX_TRIES:
                    self._give_up(ticket, reason)
                elif self._turns.take(ticket.scene_id, ticket.kind, lambda: self._unwanted(ticket)):
                    try:
                        self._try(ticket, tries)
                    finally:
                        self._turns.end(ticket.scene_id)
            except _PausedError:
                tries.excuse()
                time.sleep(_PAUSE_S)
            except StaleLeaseError:
                tries.excuse()
                _log.warning("lease lost", job=ticket.job_id)
                time.sleep(_PAUSE_S)
            except Exception as error:  # the runner's death, or the database's, or a defect: try again
                reason = str(error)
                if not isinstance(error, RunnerGoneError | _ChildDiedError):
                    reason = f"{type(error).__name__}: {error}"
                    _log.exception("attempt broke", job=ticket.job_id)
                if self._host.stopping or isinstance(error, SQLAlchemyError):
                    tries.excuse()
                in_vain = tries.in_vain(self._progress(ticket))
                _log.warning("trying again", job=ticket.job_id, in_vain=in_vain, reason=reason)
                # At first at once, so that the scene stays here: a runner takes its time to start anyway.
                time.sleep(_PAUSE_S * (in_vain - 1) if in_vain else _PAUSE_S)

    def _over(self, ticket: JobTicket) -> bool:
        """Whether there is nothing left to do: ended, or another attempt was begun."""
        try:
            with self._storage.database.reading() as session:
                job = find_job(session, ticket.job_id)
        except NotFoundError:
            return True
        except SQLAlchemyError:
            _log.warning("database unavailable", job=ticket.job_id)
            time.sleep(_PAUSE_S)
            return False
        return job.state.ended or job.attempt != ticket.attempt

    def _unwanted(self, ticket: JobTicket) -> bool:
        """Whether there is nothing to wait for: it is over, or is to be canceled."""
        return self._over(ticket) or self._storage.ledger.cancel_requested(ticket.job_id)

    def _progress(self, ticket: JobTicket) -> float:
        """How far the job has come; 0 while nobody knows."""
        try:
            with self._storage.database.reading() as session:
                return find_job(session, ticket.job_id).progress
        except SQLAlchemyError:
            return 0.0

    def _try(self, ticket: JobTicket, tries: Tries) -> None:
        tries.begin(self._progress(ticket))
        with self._storage.database.reading() as session:
            request = find_job(session, ticket.job_id).request
            images = accepted_images(session, ticket.scene_id)
        need = job_need_bytes(request, images, self._storage.settings.worker)
        with self._host.hold(ticket.scene_id, need, lambda: self._unwanted(ticket)) as hosted:
            if hosted is None:
                tries.excuse()
                return
            job = self._storage.ledger.start(hosted.lease, ticket.job_id, ticket.attempt)
            if job is None:
                return
            _log.info("job started", job=job.id, kind=job.kind.value, attempt=job.attempt)
            try:
                self._work(hosted, job)
            except _StoppedError:
                self._storage.ledger.cancel(hosted.lease, job.id)
            except _FailedError as failed:
                self._storage.ledger.fail(hosted.lease, job.id, failed.error)
            except StaleLeaseError:
                self._host.drop(hosted)
                raise
            except _ChildDiedError:
                raise  # the runner itself is well, and stays warm
            except _PausedError:
                if not self._turns.update_waits(job.scene_id):  # the update is another worker's
                    self._host.drop(hosted)
                raise
            except (ServiceError, EngineError) as error:
                told = JobError(
                    code=error.code,
                    message=error.message,
                    hint=error.hint,
                    retryable=not isinstance(error, ServiceError) or error.retryable,
                    stage=_SNAPSHOT_STAGE,
                )
                self._storage.ledger.fail(hosted.lease, job.id, told)
            except BaseException:
                self._host.drop(hosted)  # whatever it is doing, nobody listens any more
                raise
            else:
                self._storage.ledger.succeed(hosted.lease, job.id)
            shutil.rmtree(self._outcome_folder(job), ignore_errors=True)
            _log.info("job ended", job=job.id)

    def _work(self, hosted: Hosted, job: Job) -> None:
        """Everything between started and ended. What was committed by an earlier run is not done again."""
        if self._storage.ledger.stage(job.id, _SNAPSHOT_STAGE) is not None:
            return
        images = self._images_of(hosted, job)
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        question = JobQuestion(
            job_id=job.id,
            request=job.request,
            images=images,
            camera=scene.camera,
            origin=scene.origin,
            snapshot_id=scene.snapshot_id,
        )
        outcome = self._converse(hosted, job, question)
        self._commit(hosted, job, outcome, {image.digest: image for image in images})

    def _images_of(self, hosted: Hosted, job: Job) -> tuple[Image, ...]:
        """The images that had arrived when the attempt was begun: if it is begun again, it takes the same."""
        with self._storage.database.reading() as session:
            images = accepted_images(session, job.scene_id)
        last = max((image.number for image in images), default=0)
        stage = images_stage(job.attempt)
        kept = self._storage.ledger.stage(job.id, stage)
        if kept is None:
            kept = {"last_number": last}
            self._storage.ledger.commit_stage(hosted.lease, job.id, stage, kept)
        return tuple(image for image in images if image.number <= kept["last_number"])

    def _converse(self, hosted: Hosted, job: Job, question: JobQuestion) -> JobOutcome:
        """Have the runner do the job, passing on what it tells and the wish to stop."""
        talk = _Conversation(hosted.endpoint, question)
        progress = JobProgress(job.kind)
        stage: str | None = None
        why: type[_StoppedError] | type[_PausedError] | None = None
        asked_at = 0.0
        wanted = False
        while True:
            document = talk.next(_POLL_S)
            if why is None or why is _PausedError:
                if self._storage.ledger.cancel_requested(job.id):
                    why = _StoppedError
                elif job.kind is JobKind.FINE and (wanted or self._turns.update_waits(job.scene_id)):
                    why = _PausedError
                if why is not None and not asked_at:
                    asked_at = time.monotonic()
                    _ask_to_stop(hosted.endpoint)
            if why is not None and time.monotonic() - asked_at > _STOP_S:
                hosted.child.kill()  # the lease stays, so that the job's end can be written down
                raise why
            match document:
                case None:
                    continue
                case {"wanted": _}:
                    wanted = True
                case {"progress": told}:
                    note = ProgressNote.model_validate(told)
                    stage, eta_s = note.stage, progress.follow(note)
                    self._storage.ledger.report(hosted.lease, job.id, stage, progress.reached, eta_s)
                case {"warning": str(sentence)}:
                    told = with_senders_names(sentence, question.images)
                    self._storage.ledger.warn(hosted.lease, job.id, told)
                case {"result": made}:
                    return JobOutcome.model_validate(made)
                case ErrorNote():
                    if why is not None and document.code in ("cancelled", ProcessDiedError.code):
                        raise why
                    if self._host.stopping:
                        raise RunnerGoneError(document.message)  # the next worker goes on
                    if document.code == ProcessDiedError.code:
                        raise _ChildDiedError(document.message)
                    named = with_senders_names(document.message, question.images)
                    raise _FailedError(document.model_copy(update={"message": named}), stage)
                case _:
                    raise why or RunnerGoneError("The runner died.")

    def _commit(self, hosted: Hosted, job: Job, outcome: JobOutcome, images: Mapping[str, Image]) -> None:
        with self._storage.database.reading() as session:
            scene = find_scene(session, job.scene_id)
        places = {
            digest: RigidTransform.from_matrix(rows) for digest, rows in outcome.model_from_camera.items()
        }
        alignment = align(scene, images, places)
        folder = Path(outcome.folder)
        write_text_atomically(folder / ALIGNMENT, alignment.model_dump_json(indent=1))
        updating = job.kind is JobKind.UPDATE
        made = NewSnapshot(
            metrics=outcome.metrics,
            alignment=alignment,
            files={name: folder / name for name in (*outcome.files, ALIGNMENT)},
            registered=tuple(places) if updating else (),
            unregistered=outcome.unregistered if updating else (),
        )
        self._storage.snapshots.commit(hosted.lease, job, _SNAPSHOT_STAGE, made)

    def _cancel(self, ticket: JobTicket) -> None:
        """End an attempt that broke off, and is not wanted any more: no runner need be started for that."""
        with self._host.leased(ticket.scene_id, lambda: self._over(ticket)) as lease:
            if (
                lease is not None
                and self._storage.ledger.start(lease, ticket.job_id, ticket.attempt) is not None
            ):
                self._storage.ledger.cancel(lease, ticket.job_id)

    def _give_up(self, ticket: JobTicket, reason: str) -> None:
        """Fail an attempt that breaks off again and again; ``reason`` is the last one."""
        with self._host.leased(ticket.scene_id, lambda: self._over(ticket)) as lease:
            if lease is None:
                return
            job = self._storage.ledger.start(lease, ticket.job_id, ticket.attempt)
            if job is None:
                return
            error = JobError(
                code="runner-died",
                message=f"Work on the scene broke off {MAX_TRIES} times at the same point: {reason}",
                hint="Often memory ran out: use fewer or smaller images, or a machine that has more.",
                retryable=True,
                stage=job.stage,
            )
            self._storage.ledger.fail(lease, job.id, error)

    def _outcome_folder(self, job: Job) -> Path:
        return self._storage.settings.scenes / job.scene_id / "outcome" / job.id


class _Conversation:
    """A question whose answer takes long; what comes is put into a queue by a thread of its own."""

    def __init__(self, endpoint: str, question: JobQuestion) -> None:
        self._line = connect(endpoint, _CONNECT_S)
        self._line.wait_at_most(None)
        self._heard: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._listen, args=(question,), daemon=True).start()

    def next(self, timeout_s: float) -> Any:
        """The next document, an ``ErrorNote``, a ``RunnerGoneError``, or None when nothing came yet."""
        try:
            return self._heard.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def _listen(self, question: JobQuestion) -> None:
        try:
            for document in ask(self._line, question):
                self._heard.put(document)
        except RunnerError as error:
            self._heard.put(error.note)
        except RunnerGoneError as error:
            self._heard.put(error)
        finally:
            self._line.close()


def _ask_to_stop(endpoint: str) -> None:
    try:
        line = connect(endpoint, _STOP_S)
        try:
            line.wait_at_most(_STOP_S)
            answer_to(line, CancelQuestion())
        finally:
            line.close()
    except (RunnerGoneError, RunnerError):
        pass  # if it is still there after its time, it is killed
