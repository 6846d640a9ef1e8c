"""The frames that a runner takes from videos, stored as images of the scene.

Nothing is lost or doubled when a process dies: a video stays until all of its frames are stored, and a frame
that an earlier start has stored is known by its video and its name, which has its time.
"""

from pathlib import Path
from types import TracebackType

from fvs_engine.wording import notice
from fvs_schema.findings import Finding, FindingCode, Notice
from fvs_schema.images import ImageMetadata, Verdict
from fvs_schema.jobs import Job
from fvs_service.application import Storage
from fvs_service.errors import ConflictError, NotFoundError, StaleLeaseError
from fvs_service.host.protocol.messages import FrameTaken, RunJob, VideoTaken
from fvs_service.images import repository
from fvs_service.images.inspection import image_limits
from fvs_service.images.inspector import Inspector
from fvs_service.images.service import Images
from fvs_service.images.upload_files import StagedFile, file_digest
from fvs_service.images.videos import remove_bytes
from fvs_service.jobs.ledger import add_warning
from fvs_service.jobs.service import Jobs
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.scenes.repository import find_scene, tenant_of


class TakenVideos:
    """Stores the frames of one start of a job; as a context it ends the process that inspects them."""

    def __init__(self, storage: Storage, lease: Lease, job: Job) -> None:
        limits = storage.settings.limits
        self._storage, self._lease, self._job = storage, lease, job
        self._inspector = Inspector(image_limits(limits), children=1)
        jobs = Jobs(storage.database, storage.queue, limits)
        self._images = Images(storage.database, storage.blobs, self._inspector, jobs, limits)
        with storage.database.reading() as session:
            tenant_id = tenant_of(session, job.scene_id)
            self._videos = {v.digest: v for v in repository.waiting_videos(session, job.scene_id)}
            self._stored = {
                digest: repository.frames_of(session, job.scene_id, digest) for digest in self._videos
            }
            others = find_scene(session, job.scene_id).image_counts.received
        self._principal = Principal(tenant_id, frozenset({Scope.UPLOAD}))
        self._room = limits.images_per_scene - others + sum(map(len, self._stored.values()))
        self._full: dict[str, Finding] = {}

    def __enter__(self) -> "TakenVideos":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._inspector.close()

    def request(self) -> RunJob:
        """What the runner is to do: the videos that wait, and for how many frames there is room."""
        return RunJob(
            job_id=self._job.id,
            request=self._job.request,
            images=(),
            camera=None,
            origin=None,
            snapshot_id=None,
            videos=tuple(self._videos.values()),
            room=self._room,
        )

    def record(self, message: FrameTaken | VideoTaken) -> None:
        """Store a frame, or what became of a video; raises ``StaleLeaseError``."""
        try:
            if isinstance(message, FrameTaken):
                self._store(message)
            else:
                self._finish(message)
        except NotFoundError as error:  # the scene was deleted
            raise StaleLeaseError(error.message) from error

    def _store(self, frame: FrameTaken) -> None:
        file, stored = Path(frame.file), self._stored[frame.video]
        with self._storage.database.reading() as session:
            tenant_of(session, self._job.scene_id)
            deleted = repository.find_image(session, self._job.scene_id, frame.video) is None
        if deleted or frame.name in stored:
            return
        staged = StagedFile(file, file_digest(file), file.stat().st_size)
        try:
            image, _ = self._images.store(
                self._principal, self._job.scene_id, staged, ImageMetadata(name=frame.name), frame.video
            )
        except ConflictError:  # images were sent meanwhile, and the scene is full
            last = max(stored, default="the first")
            video = self._videos[frame.video].name
            full = Finding.of(FindingCode.FRAMES_LEFT_OUT, video=video, last=last)
            self._full.setdefault(frame.video, full)
        else:
            stored[frame.name] = image.digest

    def _finish(self, taken: VideoTaken) -> None:
        """Record what became of a video, whose bytes are then removed."""
        video, stored = self._videos[taken.video], self._stored[taken.video]
        full = self._full.get(taken.video)
        with self._storage.database.writing(self._job.scene_id) as session:
            require_lease(session, self._lease)
            if taken.reason:
                changed = repository.change_video(
                    session, video, Verdict.UNREADABLE, reason=taken.reason, hint=taken.hint
                )
            else:
                frames = len(set(stored.values()))
                changed = repository.change_video(session, video, Verdict.VIDEO, frames=frames)
            if changed is None:  # it was deleted
                return
            remove_bytes(session, video)
            for finding in (*taken.findings, *(() if full is None else (full,))):
                add_warning(session, self._job.id, _notice(finding, stored))


def _notice(finding: Finding, digests: dict[str, str]) -> Notice:
    """The finding for clients, with the digests of the images that are frames, each once."""
    images = dict.fromkeys(digests.get(name, name) for name in finding.images)
    return notice(finding).model_copy(update={"images": tuple(images)})
