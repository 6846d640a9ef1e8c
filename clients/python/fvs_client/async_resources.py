"""``fvs_client.resources`` for ``AsyncClient``: the same names, with ``await``."""

from collections.abc import AsyncIterator, Callable, Iterable
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr

from fvs_client import requests
from fvs_client.awaiting import AsyncSession
from fvs_client.exchange import exchange
from fvs_client.models.base import Answer
from fvs_client.models.events import Event
from fvs_client.models.images import DigestAnswer, Image, ImageMetadata
from fvs_client.models.jobs import JobData, JobKind
from fvs_client.models.rankings import Generator, Pose, RankedCandidate, RankingData
from fvs_client.models.scenes import CameraPrior, Policy, SceneData, World
from fvs_client.models.snapshots import SnapshotCameras, SnapshotData
from fvs_client.operations import downloading, uploading, waiting
from fvs_client.operations.downloading import DownloadProgress
from fvs_client.operations.events import follow
from fvs_client.operations.photographs import Paths
from fvs_client.operations.uploading import Describe, Sending, UploadProgress, UploadReport
from fvs_client.requests import Candidates


class _Resource(Answer):
    """An answer that knows whom to ask for more."""

    _session: AsyncSession = PrivateAttr()

    def model_post_init(self, context: Any, /) -> None:
        """Keep the session that the answer came over."""
        self._session = context["session"]


class AsyncRanking(_Resource, RankingData):
    """An immutable ranking; ``candidates`` come the first to be photographed first."""

    async def render(self, candidate: RankedCandidate | str) -> bytes:
        """What a candidate sees of the ranking's snapshot, as a PNG."""
        return await self._draw(candidate, "render")

    async def spectrum(self, candidate: RankedCandidate | str) -> bytes:
        """The spectrum of what a candidate sees, as a PNG."""
        return await self._draw(candidate, "spectrum")

    async def _draw(self, candidate: RankedCandidate | str, picture: str) -> bytes:
        name = candidate if isinstance(candidate, str) else candidate.id
        request = requests.draw_candidate(self.id, name, picture)
        return (await self._session.run(exchange(request, self._session.retries))).content


class AsyncSnapshot(_Resource, SnapshotData):
    """An immutable model and its files."""

    async def download(
        self,
        name: str,
        path: str | PathLike[str] = ".",
        *,
        on_progress: Callable[[DownloadProgress], object] | None = None,
    ) -> Path:
        """Write the file ``name`` to ``path`` (or into that folder), verified; returns where it is.

        A download that was broken off goes on where it ended. Raises ``DamagedDownloadError``.
        """
        artifact = downloading.artifact_of(self, name)
        target = downloading.target_of(path, name)
        operation = downloading.download(self.id, artifact, target, on_progress, self._session.retries)
        return await self._session.run(operation)

    async def cameras(self) -> SnapshotCameras:
        """Where the registered images were taken, in the model's frame."""
        artifact = downloading.artifact_of(self, "cameras.json")
        content = await self._session.run(downloading.contents(self.id, artifact, self._session.retries))
        return SnapshotCameras.model_validate_json(content)


class AsyncJob(_Resource, JobData):
    """A job, as it was when it was asked for; ``refresh`` and ``wait`` return it as it is."""

    async def refresh(self) -> "AsyncJob":
        """The job as it is now."""
        return await self._session.fetch(AsyncJob, requests.get_job(self.id))

    async def wait(
        self, *, timeout_s: float | None = None, on_progress: "Callable[[AsyncJob], object] | None" = None
    ) -> "AsyncJob":
        """Return the job once it has succeeded; ``on_progress`` is told of every change.

        Raises ``JobFailedError``, ``JobCanceledError``, or ``WaitTimeoutError`` while it goes on.
        """
        operation = waiting.wait(
            AsyncJob,
            self.id,
            self.scene_id,
            timeout_s=timeout_s,
            on_progress=on_progress,
            retries=self._session.retries,
            session=self._session,
        )
        return await self._session.run(operation)

    async def cancel(self) -> "AsyncJob":
        """Stop it; one that has ended stays as it is."""
        return await self._session.fetch(AsyncJob, requests.cancel_job(self.id))

    async def retry(self) -> "AsyncJob":
        """Queue it again after it failed or was canceled; finished stages are not repeated."""
        return await self._session.fetch(AsyncJob, requests.retry_job(self.id))

    async def snapshot(self) -> AsyncSnapshot | None:
        """The latest snapshot that it made."""
        if self.snapshot_id is None:
            return None
        return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(self.snapshot_id))


class AsyncSceneImages:
    """The images of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def upload(
        self,
        paths: Paths,
        *,
        parallel: int = 8,
        progress: Callable[[UploadProgress], object] | None = None,
        describe: Describe | None = None,
    ) -> UploadReport:
        """Send photographs: files, and folders with all that is in them.

        Bytes that the scene has already are not sent, so doing it again costs next to nothing and takes up
        what was broken off. ``describe`` may tell more of a file (a position, a name). A file that fails is
        in the report and does not stop the others; ``progress`` is called from other threads, one at a time.
        """
        sending = self._sending(parallel, describe)
        return await self._session.run(uploading.upload(paths, sending, progress))

    async def put(self, content: bytes, metadata: ImageMetadata | None = None) -> Image:
        """Send one image from memory."""
        return await self._session.run(uploading.put(content, metadata, self._sending(1, None)))

    async def check(self, digests: Iterable[str]) -> DigestAnswer:
        """Say which of these (``sha256:…``) the scene has."""
        return await self._session.fetch(DigestAnswer, requests.check_images(self._scene_id, digests))

    async def get(self, digest: str) -> Image:
        """One image."""
        return await self._session.fetch(Image, requests.get_image(self._scene_id, digest))

    def list(self) -> AsyncIterator[Image]:
        """All images in the order of arrival."""
        return self._session.every(Image, requests.images_of(self._scene_id))

    def _sending(self, parallel: int, describe: Describe | None) -> Sending:
        return Sending(self._scene_id, parallel, self._session.retries, describe, self._session)


class AsyncSceneJobs:
    """The jobs of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def create(
        self,
        kind: JobKind | str,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncJob:
        """Queue a job; while the same one waits for its turn, that one is returned.

        Raises ``ConflictError`` when the one that waits has other settings.
        """
        request = requests.create_job(
            self._scene_id, kind, iterations, long_side_px, test_every, idempotency_key
        )
        return await self._session.fetch(AsyncJob, request)

    def list(self) -> AsyncIterator[AsyncJob]:
        """All jobs, the oldest first."""
        return self._session.every(AsyncJob, requests.jobs_of(self._scene_id))


class AsyncSceneSnapshots:
    """The snapshots of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def latest(self) -> AsyncSnapshot | None:
        """The newest one; None while the scene has no model."""
        scene = await self._session.fetch(AsyncScene, requests.get_scene(self._scene_id))
        if scene.snapshot_id is None:
            return None
        return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(scene.snapshot_id))

    def list(self) -> AsyncIterator[AsyncSnapshot]:
        """All snapshots, the oldest first."""
        return self._session.every(AsyncSnapshot, requests.snapshots_of(self._scene_id))


class AsyncScene(_Resource, SceneData):
    """A scene, as it was when it was asked for; ``refresh`` returns it as it is."""

    @property
    def images(self) -> AsyncSceneImages:
        """Its images (``image_counts`` counts them)."""
        return AsyncSceneImages(self._session, self.id)

    @property
    def jobs(self) -> AsyncSceneJobs:
        """Its jobs."""
        return AsyncSceneJobs(self._session, self.id)

    @property
    def snapshots(self) -> AsyncSceneSnapshots:
        """Its snapshots."""
        return AsyncSceneSnapshots(self._session, self.id)

    async def refresh(self) -> "AsyncScene":
        """The scene as it is now."""
        return await self._session.fetch(AsyncScene, requests.get_scene(self.id))

    async def update(self, *, iterations: int | None = None, long_side_px: int | None = None) -> AsyncJob:
        """Take up all images that have arrived, and train the model on."""
        return await self.jobs.create(JobKind.UPDATE, iterations=iterations, long_side_px=long_side_px)

    async def fine(
        self,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
    ) -> AsyncJob:
        """Train the final model; measured by every ``test_every``-th image, if that is given."""
        return await self.jobs.create(
            JobKind.FINE, iterations=iterations, long_side_px=long_side_px, test_every=test_every
        )

    async def rank(
        self,
        candidates: Candidates | None = None,
        *,
        generator: Generator | None = None,
        current_pose: Pose | None = None,
        radius_m: float | None = None,
        top_k: int | None = None,
        method: str = "median-frequency",
        snapshot_id: str | None = None,
        budget: int = 1,
        seed: int = 0,
        idempotency_key: str | None = None,
    ) -> AsyncRanking:
        """Which of these poses should be photographed next? Answered at once, also while a job runs.

        ``candidates`` are poses by their ids, or a ``generator`` makes them. With ``radius_m`` only those
        count that are so near ``current_pose``. Raises ``NoSnapshotError`` while the scene has no model.
        """
        request = requests.create_ranking(
            self.id,
            candidates=candidates,
            generator=generator,
            current_pose=current_pose,
            radius_m=radius_m,
            top_k=top_k,
            method=method,
            snapshot_id=snapshot_id,
            budget=budget,
            seed=seed,
            idempotency_key=idempotency_key,
        )
        return await self._session.fetch(AsyncRanking, request)

    def events(self, after: int | None = 0) -> AsyncIterator[Event]:
        """What happened after event number ``after`` (None: only what happens from now on), for ever.

        A broken connection is taken up again, and no event is lost or comes twice.
        """
        return self._session.iterate(follow(self.id, after, self._session.retries))


class AsyncScenes:
    """All scenes."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def create(
        self,
        name: str,
        *,
        world: World | None = None,
        camera: CameraPrior | None = None,
        policy: Policy | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncScene:
        """Make a scene; by default its world is found from the GPS positions of its images."""
        return await self._session.fetch(
            AsyncScene, requests.create_scene(name, world, camera, policy, idempotency_key)
        )

    async def get(self, scene_id: str) -> AsyncScene:
        """One scene."""
        return await self._session.fetch(AsyncScene, requests.get_scene(scene_id))

    def images(self, scene_id: str) -> AsyncSceneImages:
        """The images of a scene, without asking for the scene: for a device whose API key may only send."""
        return AsyncSceneImages(self._session, scene_id)

    def list(self) -> AsyncIterator[AsyncScene]:
        """All scenes, the oldest first."""
        return self._session.every(AsyncScene, "/v1/scenes")


class AsyncJobs:
    """Jobs by their ids."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, job_id: str) -> AsyncJob:
        """One job."""
        return await self._session.fetch(AsyncJob, requests.get_job(job_id))


class AsyncSnapshots:
    """Snapshots by their ids."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, snapshot_id: str) -> AsyncSnapshot:
        """One snapshot."""
        return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(snapshot_id))


class AsyncRankings:
    """Rankings by their ids."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, ranking_id: str) -> AsyncRanking:
        """One ranking."""
        return await self._session.fetch(AsyncRanking, requests.get_ranking(ranking_id))
