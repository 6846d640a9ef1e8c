"""The runner's server: a thread per connection, one ranking at a time, one job at a time."""

import base64
import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from fvs_engine.candidates import CandidateScore
from fvs_engine.errors import Cancelled, EngineError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.jobs import JobKind
from fvs_service.engine_errors import for_clients
from fvs_service.errors import ConflictError, ServiceError
from fvs_service.host.protocol.connection import Connection, RunnerGoneError
from fvs_service.host.protocol.messages import (
    REQUEST,
    CancelJob,
    Failure,
    ForgetImages,
    JobFinished,
    JobMessage,
    ModelMade,
    Ping,
    Quarantined,
    Request,
    RunJob,
    RunnerStatus,
    SceneWanted,
    YieldScene,
    failure_of,
)
from fvs_service.host.runner.gpu_memory import GpuMemory
from fvs_service.host.runner.job_monitor import JobMonitor
from fvs_service.host.runner.listener import Listener
from fvs_service.host.runner.planning import forecast_views, generate_views, plan_views
from fvs_service.host.runner.ranking import rank_views, render_view
from fvs_service.host.runner.request_queue import Requester, RequesterGoneError, RequestQueue, Task
from fvs_service.host.runner.scene_jobs import SceneJobs
from fvs_service.host.runner.snapshot_models import SnapshotModels
from fvs_service.host.runner.video_frames import VideoFrames
from fvs_service.images.files import with_original_names
from fvs_service.rankings.port import (
    ForecastViews,
    GenerateViews,
    ModelRequest,
    PlanViews,
    RankViews,
    RenderView,
)
from fvs_service.settings import Settings
from fvs_service.storage.blobs import Blobs

T = TypeVar("T")

_log = logging.getLogger(__name__)

_FINAL = frozenset({"invalid-input", "no-images", "output-exists", "backend-unavailable"})
"""Codes of failures that a retry would meet again."""


class RunnerServer:
    """Serves requests about one scene until one of them is ``YieldScene``."""

    def __init__(self, scene_id: str, folder: Path, settings: Settings, address: str, secret: str) -> None:
        self._root = settings.root
        blobs = Blobs(settings.root.absolute() / "blobs", settings.blobs)
        self._rasterizer = create_rasterizer(settings.worker.backend)
        self._models = SnapshotModels(scene_id, blobs, self._rasterizer)
        self._memory = GpuMemory(self._rasterizer.device)
        self._jobs = SceneJobs(folder, blobs, settings.worker, self._rasterizer, self._models, self._memory)
        limits = settings.limits
        self._videos = VideoFrames(folder, blobs, limits.video_s)
        self._requests = RequestQueue(limits.rankings_queued_per_scene, limits.rankings_queued_per_key)
        self._job_running = threading.Lock()
        # One for all jobs: the SfM child ends with its thread.
        self._job_thread = ThreadPoolExecutor(1, "job")
        self._monitor: JobMonitor | None = None
        self._worker: Connection | None = None
        self._yielded = threading.Event()
        self._used = time.monotonic()
        self._listener = Listener(address, secret, self._serve_connection)

    @property
    def backend(self) -> str:
        """The name of the rasteriser in use."""
        return self._rasterizer.name

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return self._listener.address

    def serve(self) -> None:
        """Serve until the scene is yielded."""
        threading.Thread(target=self._listener.listen, daemon=True).start()
        self._yielded.wait()

    def _serve_connection(self, connection: Connection) -> None:
        try:
            while True:
                self._respond(connection, REQUEST.validate_json(connection.receive_line()))
        except (RunnerGoneError, RequesterGoneError):
            pass
        except Exception:
            _log.exception("A request cannot be read.")

    def _respond(self, connection: Connection, request: Request) -> None:
        try:
            response = {"result": self._result(connection, request)}
        except (RunnerGoneError, RequesterGoneError):
            raise
        except Exception as error:
            if not isinstance(error, EngineError | ServiceError):
                _log.exception("A request of kind %s failed.", request.kind)
            failure = self._failure_of(error, request)
            response = {"error": failure}
        try:
            connection.send(response)
        finally:
            if isinstance(request, YieldScene) and "result" in response:
                self._yielded.set()  # also when nobody receives that: no job can run any longer

    def _result(self, connection: Connection, request: Request) -> Any:
        match request:
            case RankViews():
                send = partial(_send_part, connection) if request.streamed else None
                ranked, waited_s = self._ask(
                    connection,
                    request,
                    request.method,
                    len(request.views),
                    self._with_memory(request.views, partial(rank_views, request)),
                    send,
                )
                return ranked.model_copy(update={"waited_s": waited_s})
            case RenderView():
                png, _ = self._ask(
                    connection,
                    request,
                    request.kind,
                    1,
                    self._with_memory(
                        (request.view,),
                        lambda model, rasterizer, _monitor: render_view(request, model, rasterizer),
                    ),
                )
                return base64.b64encode(png).decode()
            case GenerateViews():
                return self._ask(
                    connection, request, request.kind, request.views.count, partial(generate_views, request)
                )[0]
            case PlanViews():
                return self._ask(
                    connection, request, request.kind, len(request.views), partial(plan_views, request)
                )[0]
            case ForecastViews():
                count = request.surface or len(request.views)
                return self._ask(connection, request, request.kind, count, partial(forecast_views, request))[
                    0
                ]
            case RunJob():
                return self._run_job(connection, request)
            case CancelJob():
                monitor = self._monitor
                if monitor is not None:
                    monitor.cancel()
                return None
            case YieldScene():
                if not self._job_running.acquire(blocking=False):
                    worker = self._worker
                    if worker is not None:
                        _send_part(worker, SceneWanted())
                    raise ConflictError("A job is running.")
                return None  # the lock stays acquired, so that no other job starts
            case ForgetImages():
                if not self._job_running.acquire(blocking=False):
                    raise ConflictError("A job is running.")
                try:
                    self._jobs.forget()
                finally:
                    self._job_running.release()
                return None
            case Ping():
                queue = self._requests.status
                busy = self._job_running.locked() or queue.waiting or queue.computing
                idle_s = 0.0 if busy else time.monotonic() - self._used
                return RunnerStatus(idle_s=idle_s, queue=queue)

    def _with_memory(
        self,
        views: Sequence[PinholeView],
        render: Callable[[SceneModel, Rasterizer, Monitor], T],
    ) -> Callable[[SceneModel, Monitor], T]:
        """Call ``render`` once there is memory for the ``views``."""

        def compute(model: SceneModel, monitor: Monitor) -> T:
            with self._memory.for_renders(model, views, self._rasterizer, monitor) as rasterizer:
                return render(model, rasterizer, monitor)

        return compute

    def _ask(
        self,
        connection: Connection,
        request: ModelRequest,
        kind: str,
        views: int,
        compute: Callable[[SceneModel, Monitor], T],
        pass_on: Callable[[Sequence[Any]], object] | None = None,
    ) -> tuple[T, float]:
        """Compute a request in its turn; returns the answer and the seconds that it waited."""

        def with_model(monitor: Monitor) -> T:
            with on_device(self._rasterizer.device):
                model = self._models.of_snapshot(request.snapshot_id)
            monitor.check()
            return compute(model, monitor)

        self._used = time.monotonic()
        key = request.model_dump_json(exclude={"api_key", "timeout_s", "streamed"})
        requester = Requester(request.api_key, request.timeout_s, connection.ended, pass_on)
        return self._requests.compute(Task(key, kind, views, with_model), requester)

    def _run_job(self, connection: Connection, request: RunJob) -> JobFinished:
        if not self._job_running.acquire(blocking=False):
            raise ConflictError("Another job is running.")
        try:
            self._worker = connection
            send = partial(_send_part, connection)
            self._monitor = JobMonitor(send, self._requests)
            if request.request.kind is JobKind.FRAMES:
                self._job_thread.submit(self._videos.take, request, self._monitor, send).result()
                return JobFinished(outcome=None)
            outcome = self._job_thread.submit(
                self._jobs.run,
                request,
                self._monitor,
                lambda reasons: _send_part(connection, Quarantined(reasons=dict(reasons))),
                lambda name, made: _send_part(connection, ModelMade(name=name, outcome=made)),
            ).result()
            return JobFinished(outcome=outcome)
        finally:
            self._monitor, self._worker, self._used = None, None, time.monotonic()
            self._job_running.release()

    def _failure_of(self, error: Exception, request: Request) -> Failure:
        """The message for a failed request; that for a failed job has the engine's own code."""
        if not (isinstance(error, EngineError) and isinstance(request, RunJob)):
            return failure_of(error, self._root)
        texts = for_clients(error, self._root)
        message, hint = (with_original_names(text, request.images) for text in texts)
        retryable = error.code not in _FINAL or isinstance(error, Cancelled)
        return Failure(code=error.code, message=message, hint=hint, retryable=retryable)


def _send_part(connection: Connection, part: JobMessage | Sequence[CandidateScore]) -> None:
    connection.send({"part": part})
