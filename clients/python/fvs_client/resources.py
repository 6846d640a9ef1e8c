"""Scenes, images, jobs, snapshots and rankings: data, with what can be done about them."""

from collections.abc import Callable, Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr

from fvs_client import requests
from fvs_client.blocking import Session
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

    _session: Session = PrivateAttr()

    def model_post_init(self, context: Any, /) -> None:
        """Keep the session that the answer came over."""
        self._session = context["session"]


class Ranking(_Resource, RankingData):
    """An immutable ranking; ``candidates`` come the first to be photographed first."""

    def render(self, candidate: RankedCandidate | str) -> bytes:
        """What a candidate sees of the ranking's snapshot, as a PNG."""
        return self._draw(candidate, "render")

    def spectrum(self, candidate: RankedCandidate | str) -> bytes:
        """The spectrum of what a candidate sees, as a PNG."""
        return self._draw(candidate, "spectrum")

    def _draw(self, candidate: RankedCandidate | str, picture: str) -> bytes:
        name = candidate if isinstance(candidate, str) else candidate.id
        request = requests.draw_candidate(self.id, name, picture)
        return self._session.run(exchange(request, self._session.retries)).content


class Snapshot(_Resource, SnapshotData):
    """An immutable model and its files."""

    def download(
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
        return self._session.run(operation)

    def cameras(self) -> SnapshotCameras:
        """Where the registered images were taken, in the model's frame."""
        artifact = downloading.artifact_of(self, "cameras.json")
        content = self._session.run(downloading.contents(self.id, artifact, self._session.retries))
        return SnapshotCameras.model_validate_json(content)


class Job(_Resource, JobData):
    """A job, as it was when it was asked for; ``refresh`` and ``wait`` return it as it is."""

    def refresh(self) -> "Job":
        """The job as it is now."""
        return self._session.fetch(Job, requests.get_job(self.id))

    def wait(
        self, *, timeout_s: float | None = None, on_progress: "Callable[[Job], object] | None" = None
    ) -> "Job":
        """Return the job once it has succeeded; ``on_progress`` is told of every change.

        Raises ``JobFailedError``, ``JobCanceledError``, or ``WaitTimeoutError`` while it goes on.
        """
        operation = waiting.wait(
            Job,
            self.id,
            self.scene_id,
            timeout_s=timeout_s,
            on_progress=on_progress,
            retries=self._session.retries,
            session=self._session,
        )
        return self._session.run(operation)

    def cancel(self) -> "Job":
        """Stop it; one that has ended stays as it is."""
        return self._session.fetch(Job, requests.cancel_job(self.id))

    def retry(self) -> "Job":
        """Queue it again after it failed or was canceled; finished stages are not repeated."""
        return self._session.fetch(Job, requests.retry_job(self.id))

    def snapshot(self) -> Snapshot | None:
        """The latest snapshot that it made."""
        if self.snapshot_id is None:
            return None
        return self._session.fetch(Snapshot, requests.get_snapshot(self.snapshot_id))


class SceneImages:
    """The images of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def upload(
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
        return self._session.run(uploading.upload(paths, sending, progress))

    def put(self, content: bytes, metadata: ImageMetadata | None = None) -> Image:
        """Send one image from memory."""
        return self._session.run(uploading.put(content, metadata, self._sending(1, None)))

    def check(self, digests: Iterable[str]) -> DigestAnswer:
        """Say which of these (``sha256:…``) the scene has."""
        return self._session.fetch(DigestAnswer, requests.check_images(self._scene_id, digests))

    def get(self, digest: str) -> Image:
        """One image."""
        return self._session.fetch(Image, requests.get_image(self._scene_id, digest))

    def list(self) -> Iterator[Image]:
        """All images in the order of arrival."""
        return self._session.every(Image, requests.images_of(self._scene_id))

    def _sending(self, parallel: int, describe: Describe | None) -> Sending:
        return Sending(self._scene_id, parallel, self._session.retries, describe, self._session)


class SceneJobs:
    """The jobs of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def create(
        self,
        kind: JobKind | str,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Queue a job; while the same one waits for its turn, that one is returned.

        Raises ``ConflictError`` when the one that waits has other settings.
        """
        request = requests.create_job(
            self._scene_id, kind, iterations, long_side_px, test_every, idempotency_key
        )
        return self._session.fetch(Job, request)

    def list(self) -> Iterator[Job]:
        """All jobs, the oldest first."""
        return self._session.every(Job, requests.jobs_of(self._scene_id))


class SceneSnapshots:
    """The snapshots of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def latest(self) -> Snapshot | None:
        """The newest one; None while the scene has no model."""
        scene = self._session.fetch(Scene, requests.get_scene(self._scene_id))
        if scene.snapshot_id is None:
            return None
        return self._session.fetch(Snapshot, requests.get_snapshot(scene.snapshot_id))

    def list(self) -> Iterator[Snapshot]:
        """All snapshots, the oldest first."""
        return self._session.every(Snapshot, requests.snapshots_of(self._scene_id))


class Scene(_Resource, SceneData):
    """A scene, as it was when it was asked for; ``refresh`` returns it as it is."""

    @property
    def images(self) -> SceneImages:
        """Its images (``image_counts`` counts them)."""
        return SceneImages(self._session, self.id)

    @property
    def jobs(self) -> SceneJobs:
        """Its jobs."""
        return SceneJobs(self._session, self.id)

    @property
    def snapshots(self) -> SceneSnapshots:
        """Its snapshots."""
        return SceneSnapshots(self._session, self.id)

    def refresh(self) -> "Scene":
        """The scene as it is now."""
        return self._session.fetch(Scene, requests.get_scene(self.id))

    def update(self, *, iterations: int | None = None, long_side_px: int | None = None) -> Job:
        """Take up all images that have arrived, and train the model on."""
        return self.jobs.create(JobKind.UPDATE, iterations=iterations, long_side_px=long_side_px)

    def fine(
        self,
        *,
        iterations: int | None = None,
        long_side_px: int | None = None,
        test_every: int | None = None,
    ) -> Job:
        """Train the final model; measured by every ``test_every``-th image, if that is given."""
        return self.jobs.create(
            JobKind.FINE, iterations=iterations, long_side_px=long_side_px, test_every=test_every
        )

    def rank(
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
    ) -> Ranking:
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
        return self._session.fetch(Ranking, request)

    def events(self, after: int | None = 0) -> Iterator[Event]:
        """What happened after event number ``after`` (None: only what happens from now on), for ever.

        A broken connection is taken up again, and no event is lost or comes twice.
        """
        return self._session.iterate(follow(self.id, after, self._session.retries))


class Scenes:
    """All scenes."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def create(
        self,
        name: str,
        *,
        world: World | None = None,
        camera: CameraPrior | None = None,
        policy: Policy | None = None,
        idempotency_key: str | None = None,
    ) -> Scene:
        """Make a scene; by default its world is found from the GPS positions of its images."""
        return self._session.fetch(Scene, requests.create_scene(name, world, camera, policy, idempotency_key))

    def get(self, scene_id: str) -> Scene:
        """One scene."""
        return self._session.fetch(Scene, requests.get_scene(scene_id))

    def images(self, scene_id: str) -> SceneImages:
        """The images of a scene, without asking for the scene: for a device whose API key may only send."""
        return SceneImages(self._session, scene_id)

    def list(self) -> Iterator[Scene]:
        """All scenes, the oldest first."""
        return self._session.every(Scene, "/v1/scenes")


class Jobs:
    """Jobs by their ids."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, job_id: str) -> Job:
        """One job."""
        return self._session.fetch(Job, requests.get_job(job_id))


class Snapshots:
    """Snapshots by their ids."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, snapshot_id: str) -> Snapshot:
        """One snapshot."""
        return self._session.fetch(Snapshot, requests.get_snapshot(snapshot_id))


class Rankings:
    """Rankings by their ids."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, ranking_id: str) -> Ranking:
        """One ranking."""
        return self._session.fetch(Ranking, requests.get_ranking(ranking_id))
