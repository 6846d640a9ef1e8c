"""Where a runner listens: a thread per connection, and one job at a time."""

import base64
import hmac
import logging
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from fvs_engine.errors import Cancelled, EngineError
from fvs_engine.splat.raster import create_rasterizer
from fvs_service.errors import ConflictError, ServiceError
from fvs_service.settings import Settings
from fvs_service.storage.blobs import Blobs
from fvs_service.worker.protocol import (
    QUESTION,
    CancelQuestion,
    DrawQuestion,
    ErrorNote,
    JobQuestion,
    Line,
    PingQuestion,
    ProgressNote,
    Question,
    RankQuestion,
    RunnerGoneError,
    YieldQuestion,
    note_of,
)
from fvs_service.worker.runner.answers import document_of, draw_view, rank_views
from fvs_service.worker.runner.learning import Learner
from fvs_service.worker.runner.pace import JobMonitor, Pace
from fvs_service.worker.runner.states import States

_log = logging.getLogger(__name__)
_BACKLOG = 128

_FINAL = frozenset({"invalid-input", "no-images", "output-exists", "backend-unavailable"})
"""Codes of failures that the same job would meet again."""


class RunnerServer:
    """Answers questions about one scene until it is asked to yield."""

    def __init__(self, scene_id: str, folder: Path, settings: Settings, secret: str) -> None:
        self._secret = secret
        blobs = Blobs(settings.root.absolute() / "blobs", settings.blobs_url)
        self._rasterizer = create_rasterizer(settings.worker.backend)
        self._states = States(scene_id, blobs, self._rasterizer)
        self._learner = Learner(folder, blobs, settings.worker, self._rasterizer, self._states)
        self._pace = Pace()
        self._working = threading.Lock()
        self._monitor: JobMonitor | None = None
        self._worker: Line | None = None
        self._yielded = threading.Event()
        self._touched = time.monotonic()
        self._socket = socket.create_server(("127.0.0.1", 0), backlog=_BACKLOG)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        host, port = self._socket.getsockname()[:2]
        return host, port

    def serve(self) -> None:
        """Answer until somebody asks to yield."""
        threading.Thread(target=self._accept, daemon=True).start()
        self._yielded.wait()

    def _accept(self) -> None:
        while True:
            connection, _ = self._socket.accept()
            threading.Thread(target=self._talk, args=(Line(connection),), daemon=True).start()

    def _talk(self, line: Line) -> None:
        try:
            told = line.receive().get("secret", "")
            if not hmac.compare_digest(str(told).encode(), self._secret.encode()):
                return
            while True:
                self._reply(line, QUESTION.validate_python(line.receive(), strict=False))
        except RunnerGoneError:
            pass
        except Exception:
            _log.exception("A question could not be read.")
        finally:
            line.close()

    def _reply(self, line: Line, question: Question) -> None:
        try:
            answer = {"result": self._result(line, question)}
        except RunnerGoneError:
            raise
        except Exception as error:
            if not isinstance(error, EngineError | ServiceError):
                _log.exception("A question of kind %s failed.", question.kind)
            note = _note_of_job(error) if isinstance(question, JobQuestion) else note_of(error)
            answer = {"error": note.model_dump(mode="json")}
        line.send(answer)
        if isinstance(question, YieldQuestion) and "result" in answer:
            self._yielded.set()

    def _result(self, line: Line, question: Question) -> Any:
        match question:
            case RankQuestion():
                self._touched = time.monotonic()
                with self._pace.answering() as waited_s:
                    find = self._states.exactly if question.pinned else self._states.newest
                    ranked = rank_views(question, find(question.snapshot_id), self._rasterizer)
                return document_of(replace(ranked, waited_s=waited_s))
            case DrawQuestion():
                self._touched = time.monotonic()
                with self._pace.answering():
                    state = self._states.exactly(question.snapshot_id)
                    return base64.b64encode(draw_view(question, state, self._rasterizer)).decode()
            case JobQuestion():
                return self._work(line, question)
            case CancelQuestion():
                monitor = self._monitor
                if monitor is not None:
                    monitor.cancel()
                return None
            case YieldQuestion():
                if not self._working.acquire(blocking=False):
                    worker = self._worker
                    if worker is not None:
                        worker.send({"wanted": True})
                    raise ConflictError("A job is running.")
                return None  # and no other job begins
            case PingQuestion():
                return {"idle_s": 0.0 if self._working.locked() else time.monotonic() - self._touched}

    def _work(self, line: Line, question: JobQuestion) -> Any:
        if not self._working.acquire(blocking=False):
            raise ConflictError("Another job is running.")
        try:
            self._worker = line
            self._monitor = JobMonitor(
                lambda note: _tell(line, note),
                self._pace,
                lambda iteration: self._learner.on_step(question, iteration),
            )
            outcome = self._learner.run(
                question, self._monitor, lambda sentence: line.send({"warning": sentence})
            )
            return outcome.model_dump(mode="json")
        finally:
            self._monitor, self._worker, self._touched = None, None, time.monotonic()
            self._working.release()


def _tell(line: Line, note: ProgressNote) -> None:
    line.send({"progress": note.model_dump(mode="json")})


def _note_of_job(error: Exception) -> ErrorNote:
    """Why a job failed, in the engine's own codes."""
    if not isinstance(error, EngineError):
        return note_of(error)
    retryable = error.code not in _FINAL or isinstance(error, Cancelled)
    return ErrorNote(code=error.code, message=error.message, hint=error.hint, retryable=retryable)
