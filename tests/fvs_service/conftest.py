"""A gateway for tests: the real application, with an engine and runners that compute in this process.

With FVS_TEST_DATABASE=postgresql every gateway has a database of its own on a PostgreSQL server.
"""

import atexit
import contextlib
import functools
import hashlib
import io
import logging
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import piexif
import pytest
import structlog
import torch
import uvicorn
from anyio.to_thread import run_sync
from fastapi import FastAPI
from fvs_service.application import Application, Storage
from fvs_service.errors import UnavailableError, from_engine
from fvs_service.gateway.connection import http_protocol
from fvs_service.gateway.rest.app import create_app
from fvs_service.jobs.queue import take_job
from fvs_service.jobs.ticket import JobTicket
from fvs_service.logs import configure_logging
from fvs_service.rankings.port import (
    GeneratedViews,
    GenerateViews,
    PlannedFlight,
    PlanViews,
    RankedViews,
    RankingSteps,
    RankViews,
    RenderView,
    SceneRunners,
)
from fvs_service.scenes.lease import Lease
from fvs_service.scenes.model import Alignment
from fvs_service.settings import Settings
from fvs_service.snapshots.artifacts import CAMERAS, GAUSSIANS, find_artifact
from fvs_service.snapshots.model import (
    PinholeIntrinsics,
    SnapshotCameras,
    SnapshotMetrics,
    SnapshotView,
)
from fvs_service.snapshots.service import NewSnapshot
from fvs_service.storage.tables import JobRow
from fvs_service.worker.runner.model_states import ModelState
from fvs_service.worker.runner.planning import generate_views, plan_views
from lasting_inspectors import share_inspectors
from PIL import Image
from postgresql_server import PostgresqlServer, programs
from sqlalchemy import select
from starlette.testclient import TestClient

from fvs_engine.candidates import CandidateScore
from fvs_engine.errors import EngineError
from fvs_engine.geometry import look_at, quaternion_from_matrix
from fvs_engine.plan.registration import Observations
from fvs_engine.score import MedianFrequency, rank
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import read_ply, write_ply
from fvs_engine.splat.raster import create_rasterizer

share_inspectors()

Overrides = Mapping[str, Any]


class ComputingRunners:
    """Ranks and renders with the engine, from the snapshot's own artifacts."""

    methods = ("median-frequency",)

    def __init__(self, storage: Storage) -> None:
        self._blobs = storage.blobs
        self._rasterizer = create_rasterizer("cpu")
        self.reachable = True
        self.asked: list[RankViews] = []
        self.generated: list[GenerateViews] = []

    async def rank(self, request: RankViews) -> RankedViews:
        self._require_reachable()
        self.asked.append(request)
        return await run_sync(self._rank, request)

    async def stream(self, request: RankViews) -> RankingSteps:
        """Each candidate by itself, then the result."""
        ranked = await self.rank(request)
        for one in ranked.candidates:
            yield (CandidateScore(one.name, one.score, one.status, one.coverage),)
        yield ranked

    async def plan(self, request: PlanViews) -> PlannedFlight:
        self._require_reachable()
        return await run_sync(self._plan, request)

    async def generate(self, request: GenerateViews) -> GeneratedViews:
        self._require_reachable()
        self.generated.append(request)
        return await run_sync(self._generate, request)

    async def render(self, request: RenderView) -> bytes:
        self._require_reachable()
        return await run_sync(self._render, request)

    async def close(self) -> None: ...

    def _rank(self, request: RankViews) -> RankedViews:
        gaussians = self._gaussians(request.scene_id, request.snapshot_id)
        scores = MedianFrequency().score(gaussians, request.views, self._rasterizer)
        return RankedViews(
            snapshot_id=request.snapshot_id,
            iterations=7,
            gaussians=len(gaussians),
            candidates=rank(scores, request.distances),
        )

    def _plan(self, request: PlanViews) -> PlannedFlight:
        try:
            return plan_views(request, self._state(request))
        except EngineError as error:
            raise from_engine(error) from error

    def _generate(self, request: GenerateViews) -> GeneratedViews:
        try:
            return generate_views(request, self._state(request))
        except EngineError as error:
            raise from_engine(error) from error

    def _state(self, request: PlanViews | GenerateViews) -> ModelState:
        content = self._blobs.read(find_artifact(self._blobs, request.scene_id, request.snapshot_id, CAMERAS))
        cameras = SnapshotCameras.model_validate_json(content)
        gaussians = self._gaussians(request.scene_id, request.snapshot_id)
        nothing = Observations(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        return ModelState(request.snapshot_id, gaussians, 0, cameras, 7, lambda: nothing)

    def _render(self, request: RenderView) -> bytes:
        gaussians = self._gaussians(request.scene_id, request.snapshot_id)
        with torch.no_grad():
            drawn = self._rasterizer.render(gaussians, request.view.camera, request.view.camera_from_model)
        pixels = (drawn.color.clamp(0, 1).numpy() * 255).astype(np.uint8)
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, "PNG")
        return out.getvalue()

    def _gaussians(self, scene_id: str, snapshot_id: str) -> Gaussians:
        content = self._blobs.read(find_artifact(self._blobs, scene_id, snapshot_id, GAUSSIANS))
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(_temporary_folder())
            (folder / GAUSSIANS).write_bytes(content)
            return read_ply(folder / GAUSSIANS)

    def _require_reachable(self) -> None:
        if not self.reachable:
            raise UnavailableError("No runner answers.", retry_after_s=3)


@contextlib.contextmanager
def _temporary_folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@dataclass
class Gateway:
    """A running gateway, what it stands on, and a client for it."""

    app: FastAPI
    client: httpx2.Client
    settings: Settings

    @property
    def application(self) -> Application:
        return self.app.state.application

    @property
    def runners(self) -> ComputingRunners:
        runners = self.application.runners
        assert isinstance(runners, ComputingRunners)
        return runners

    def key(self, tenant_id: str, **options: Any) -> dict[str, str]:
        """Headers of a new key."""
        key = self.application.storage.keys.create("test", tenant_id=tenant_id, **options)
        return {"Authorization": f"Bearer {key}"}

    def scene(self, headers: Mapping[str, str] | None = None, **request: Any) -> str:
        """A new scene's id."""
        made = self.client.post("/v1/scenes", json={"name": "a scene", **request}, headers=headers)
        assert made.status_code == 201, made.text
        return made.json()["id"]

    def put(
        self, scene_id: str, content: bytes, headers: Mapping[str, str] | None = None, **metadata: Any
    ) -> httpx2.Response:
        """Send an image's bytes."""
        digest = hashlib.sha256(content).hexdigest()
        path = f"/v1/scenes/{scene_id}/images/sha256:{digest}"
        return self.client.put(path, content=content, params=metadata, headers=headers)

    def queue(self, scene_id: str, kind: str = "update", headers: Mapping[str, str] | None = None) -> str:
        """A new job's id."""
        made = self.client.post(f"/v1/scenes/{scene_id}/jobs", json={"kind": kind}, headers=headers)
        assert made.status_code == 202, made.text
        return made.json()["id"]

    def queued_jobs(self) -> dict[str, str]:
        """The ids of all queued jobs, with those of their scenes."""
        with self.application.storage.database.reading() as session:
            query = select(JobRow.id, JobRow.scene_id).where(JobRow.state == "queued")
            return {row.id: row.scene_id for row in session.execute(query)}

    def take(self, job_id: str, worker_id: str = "tester") -> JobTicket:
        """The ticket of a job, which is the worker's from now on."""
        with self.application.storage.database.writing() as session:
            ticket = take_job(session, job_id, worker_id)
        assert ticket is not None
        return ticket

    def lease(self, scene_id: str, worker_id: str = "tester") -> Lease:
        """The right to work on a scene."""
        lease = self.application.storage.leases.acquire(scene_id, worker_id)
        assert lease is not None
        return lease

    def model(
        self,
        scene_id: str,
        headers: Mapping[str, str] | None = None,
        alignment: Alignment | None = None,
        seed: int | None = None,
        *,
        images: int = 6,
        new_images_psnr_db: float | None = None,
    ) -> str:
        """Run an update that makes a small model of ``images``; returns its snapshot's id.

        Models with the same ``seed`` are equal; without one the model differs from all others of the scene.
        """
        job_id = self.queue(scene_id, headers=headers)
        storage, lease = self.application.storage, self.lease(scene_id)
        job = storage.ledger.start(lease, job_id, 1)
        assert job is not None
        with _temporary_folder() as folder:
            number = 5 + self._snapshots_of(scene_id, headers) if seed is None else seed
            made = small_model(folder, alignment or Alignment(), number, images, new_images_psnr_db)
            snapshot = storage.snapshots.commit(lease, job, "snapshot", made)
        storage.ledger.succeed(lease, job_id)
        storage.leases.release(lease)
        return snapshot.id

    def _snapshots_of(self, scene_id: str, headers: Mapping[str, str] | None) -> int:
        listed = self.client.get(f"/v1/scenes/{scene_id}/snapshots", headers=headers)
        return len(listed.json()["items"])


def small_model(
    folder: Path,
    alignment: Alignment,
    seed: int = 5,
    images: int = 6,
    new_images_psnr_db: float | None = None,
) -> NewSnapshot:
    """Sixty coloured Gaussians around the origin, and cameras at a distance of 4, six in a ring."""
    generator = torch.Generator().manual_seed(seed)
    count = 60
    write_ply(
        folder / GAUSSIANS,
        Gaussians(
            means=torch.randn((count, 3), generator=generator) * 0.5,
            log_scales=torch.full((count, 3), -1.0),
            quaternions_wxyz=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(count, 1),
            opacity_logits=torch.full((count,), 2.0),
            sh_dc=torch.randn((count, 3), generator=generator),
            sh_rest=torch.zeros((count, 0, 3)),
        ),
    )
    views = []
    for number in range(images):
        angle = number * np.pi / 3
        height = 1.0 + number // 6
        camera = look_at([4 * np.cos(angle), 4 * np.sin(angle), height], [0, 0, 0], [0, 0, 1])
        views.append(
            SnapshotView(
                image=f"sha256:{number:064x}",
                name=f"{number}.jpg",
                position=tuple(camera.translation.tolist()),
                orientation_wxyz=tuple(quaternion_from_matrix(camera.rotation).tolist()),
            )
        )
    cameras = SnapshotCameras(
        camera=PinholeIntrinsics(width_px=32, height_px=24, fx_px=30, fy_px=30, cx_px=16, cy_px=12),
        views=tuple(views),
        centre=(0, 0, 0),
        up=(0, 0, 1),
        lower=(-1, -1, -1),
        upper=(1, 1, 1),
    )
    (folder / CAMERAS).write_text(cameras.model_dump_json())
    return NewSnapshot(
        metrics=SnapshotMetrics(
            registered=images,
            unregistered=0,
            points=9,
            iterations=7,
            gaussians=60,
            sh_degree=0,
            new_images_psnr_db=new_images_psnr_db,
        ),
        alignment=alignment,
        files={CAMERAS: folder / CAMERAS, GAUSSIANS: folder / GAUSSIANS},
        registered=(),
        unregistered=(),
    )


@pytest.fixture(scope="session")
def postgresql() -> PostgresqlServer:
    """A PostgreSQL server that all tests share.

    Where its programs are missing, tests skip; in CI (CI=true) they fail.
    """
    if programs() is None:
        missing = "PostgreSQL is not installed (Debian: apt-get install postgresql)"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)
    return _server()


@functools.cache
def _server() -> PostgresqlServer:
    folder = tempfile.TemporaryDirectory(prefix="fvs-postgresql-")
    server = PostgresqlServer(Path(folder.name) / "server")
    server.start()
    atexit.register(folder.cleanup)
    atexit.register(server.stop)
    return server


@functools.cache
def _database_of(root: Path) -> str | None:
    """The URL of the database for a folder; None for SQLite."""
    if os.environ.get("FVS_TEST_DATABASE") != "postgresql":
        return None
    return _server().create_database(hashlib.sha256(str(root).encode()).hexdigest()[:16])


def _settings(root: Path, overrides: Overrides) -> Settings:
    limits = {"image_pixels": 2_000_000, **overrides.get("limits", {})}
    others = {name: value for name, value in overrides.items() if name != "limits"}
    return Settings(
        **{
            "root": root,
            "inspectors": 1,
            "reserve_bytes": 0,
            "event_poll_s": 0.02,
            "database_url": _database_of(root),
            "limits": limits,
            **others,
        }
    )


@pytest.fixture(scope="session")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    """The gateway of a single user's machine; all tests share it, each makes scenes of its own."""
    with _running(_settings(tmp_path_factory.mktemp("gateway") / "service", {})) as gateway:
        yield gateway


def _to_captured_stderr(*_: object) -> structlog.PrintLogger:
    return structlog.PrintLogger(io.StringIO() if sys.stderr is sys.__stderr__ else sys.stderr)


@pytest.fixture(autouse=True)
def _plain_logs(pytestconfig: pytest.Config) -> Iterator[None]:
    """Log as the service does, in the tests of the service alone.

    A server in a thread logs the end of a stream when the test that read it has ended: where pytest does not
    capture just then, that line goes nowhere instead of between the dots.
    """
    configure_logging(machine=True)
    if pytestconfig.getoption("capture") != "no":
        structlog.configure(logger_factory=_to_captured_stderr)
    root = logging.getLogger()
    own = tuple(root.handlers)
    yield
    for handler in own:
        root.removeHandler(handler)


@pytest.fixture(scope="session")
def running() -> Callable[[Settings], contextlib.AbstractContextManager[Gateway]]:
    """Run a gateway in a ``with`` block."""
    return _running


@pytest.fixture(scope="session")
def settings_of() -> Callable[[Path, Overrides], Settings]:
    """Settings for tests: quick to start, in a folder, with some of them changed."""
    return _settings


@pytest.fixture
def open_gateway(tmp_path: Path) -> Iterator[Callable[..., Gateway]]:
    """Open a gateway of one's own, with other settings than the default."""
    with contextlib.ExitStack() as stack:
        yield lambda **overrides: stack.enter_context(_running(_settings(tmp_path / "service", overrides)))


@contextlib.contextmanager
def _running(settings: Settings) -> Iterator[Gateway]:
    app = create_app(settings, ComputingRunners)
    with TestClient(app, "http://127.0.0.1", raise_server_exceptions=False) as client:
        yield Gateway(app, client, settings)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Gateway]]:
    """Start a gateway on a free port of loopback, for what needs a real connection."""
    stops: list[Callable[[], None]] = []

    def start(runners: Callable[[Storage], SceneRunners] = ComputingRunners, **overrides: Any) -> Gateway:
        settings = _settings(tmp_path / "service", overrides)
        app = create_app(settings, runners)
        protocol = http_protocol(settings.upload_idle_s, read_within_s=settings.read_within_s)
        config = uvicorn.Config(app, port=0, log_level="error", timeout_graceful_shutdown=1, http=protocol)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run)
        thread.start()
        while not server.started:
            assert thread.is_alive()
            time.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        client = httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=30)

        def stop() -> None:
            client.close()
            server.should_exit = True
            thread.join()

        stops.append(stop)
        return Gateway(app, client, settings)

    yield start
    for stop in stops:
        stop()


@pytest.fixture(scope="session")
def photograph() -> Callable[..., bytes]:
    """Make a photograph: sharp noise of its own per ``seed``, with the EXIF that is asked for."""

    def make(
        seed: int = 0,
        size: tuple[int, int] = (96, 64),
        image_format: str = "JPEG",
        exif: Mapping[str, Any] | None = None,
    ) -> bytes:
        width, height = size
        pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
        out = io.BytesIO()
        options = {"exif": piexif.dump(dict(exif))} if exif else {}
        Image.fromarray(pixels).save(out, image_format, **options)
        return out.getvalue()

    return make
