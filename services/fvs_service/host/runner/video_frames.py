"""Frames of a scene's videos: a child process takes them, because decoders crash and hang on hostile files.

The child writes whole files, which are passed on while it runs: what a video has given before its decoder
dies is not lost.
"""

import contextlib
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from pebble import ProcessExpired, ProcessPool

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor, Progress
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.images import Image
from fvs_schema.stages import Stage
from fvs_schema.videos import frame_stem
from fvs_service.errors import NotFoundError
from fvs_service.host.protocol.messages import FrameTaken, RunJob, VideoTaken
from fvs_service.host.runner.scene_folder import SceneFolder
from fvs_service.images.inspector import limit_child
from fvs_service.images.upload_files import file_digest
from fvs_service.storage.blob_keys import subtitles_key, video_key
from fvs_service.storage.blobs import Blobs

_MEMORY_BYTES = 4_000_000_000
"""Address space of the child."""
_SLOWEST = 10.0
"""The child is also killed when it takes this multiple of the longest video's length."""
_POLL_S = 0.2
_WHOLE = 1000
"""The unit of progress is a thousandth of a video."""

Send = Callable[[FrameTaken | VideoTaken], None]


class VideoFrames:
    """Takes the frames of one scene's videos; the longest that is accepted has ``longest_s``."""

    def __init__(self, folder: Path, blobs: Blobs, longest_s: float) -> None:
        self._folder = SceneFolder(folder)
        self._blobs = blobs
        self._longest_s = longest_s

    def take(self, request: RunJob, monitor: Monitor, send: Send) -> None:
        """Send the frames of each video of a job, then that it is done with.

        Raises ``InvalidInputError`` at the end when a video has no frame that can be used, or the scene no
        room for any of it, and ``Cancelled``.
        """
        failed: list[InvalidInputError] = []
        digests: set[str] = set()  # equal frames, as of a screen that stands still, are one image
        for number, video in enumerate(request.videos):
            try:
                with (
                    self._files(request.job_id, video) as files,
                    contextlib.closing(self._taken(video, files, request.room - len(digests))) as taken,
                ):
                    for share, frame in taken:
                        done = round(_WHOLE * (number + share))
                        monitor.report(Stage.FRAMES, done, _WHOLE * len(request.videos))
                        monitor.check()
                        if isinstance(frame, FrameTaken):
                            digests.add(file_digest(Path(frame.file)))
                        if frame is not None:
                            send(frame)
            except NotFoundError:  # it was deleted
                continue
            except InvalidInputError as error:
                failed.append(error)
        if failed:
            raise failed[0]

    @contextlib.contextmanager
    def _files(self, job_id: str, video: Image) -> Generator["_Files"]:
        """The files of a video; those of its frames stay until they are stored."""
        folder = self._folder.outcome(job_id) / video.sha256
        shutil.rmtree(folder, ignore_errors=True)
        name = frame_stem(video.name) + Path(video.name).suffix
        files = _Files(folder / name, folder / "frames", folder / "share")
        files.frames.mkdir(parents=True)
        try:
            self._blobs.export(video_key(video.scene_id, video.sha256), files.video)
            with contextlib.suppress(NotFoundError):
                key = subtitles_key(video.scene_id, video.sha256)
                self._blobs.export(key, files.video.with_suffix(".SRT"))
            yield files
        finally:
            files.video.unlink(missing_ok=True)

    def _taken(
        self, video: Image, files: "_Files", room: int
    ) -> Generator[tuple[float, FrameTaken | VideoTaken | None]]:
        """How far a video is, again and again, with what is to be sent."""
        if room < 1:
            raise InvalidInputError(
                f"The scene has no room for frames of {video.name}.",
                hint="Delete images and retry the job, or send the video to another scene.",
            )
        pool = ProcessPool(
            1,
            context=multiprocessing.get_context("spawn"),
            initializer=limit_child,
            initargs=(os.getpid(), _MEMORY_BYTES),
        )
        found: set[str] = set()
        try:
            timeout_s = _SLOWEST * self._longest_s
            task = pool.schedule(_write_frames, (files, video.every_s, room), timeout=timeout_s)
            ended = False
            while not ended:
                ended = task.done()  # before the look at the files, of which none comes later
                new = sorted({file.name for file in files.frames.glob("*.jpg")} - found)
                for name in new[: room - len(found)]:
                    found.add(name)
                    taken = FrameTaken(video=video.digest, name=name, file=str(files.frames / name))
                    yield files.share(), taken
                if not ended:
                    yield files.share(), None
                    time.sleep(_POLL_S)
            result: VideoTaken = task.result()
        except (ProcessExpired, TimeoutError):
            result = _died(video.name, max(found, default=None))
        finally:
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()
        yield 1.0, result.model_copy(update={"video": video.digest})
        if not found:
            raise InvalidInputError(f"{video.name}: {result.reason}", hint=result.hint)


@dataclass(frozen=True)
class _Files:
    """A video, the folder of its frames, and the file in which the child says how far it is."""

    video: Path
    frames: Path
    progress: Path

    def share(self) -> float:
        """The share of the video whose frames are taken."""
        try:
            return float(self.progress.read_text())
        except (OSError, ValueError):
            return 0.0


def _write_frames(files: _Files, every_s: float, most: int) -> VideoTaken:
    """In the child: write the frames; one more than ``most`` tells that there are more than that."""
    from fvs_engine.video.extract import damage, findings_on_frames, written_frames
    from fvs_engine.video.reading import open_video, read_track

    findings: list[Finding] = []
    name = files.video.name
    try:
        with open_video(files.video) as video:
            spaced_s = spacing_within(most, video.duration_s, every_s)
            if spaced_s > every_s:
                findings.append(
                    Finding.of(
                        FindingCode.FRAMES_SPACED_WIDER,
                        video=name,
                        room=most,
                        every_s=every_s,
                        spaced_s=spaced_s,
                    )
                )
            track = read_track(files.video)
            written = written_frames(video, track, files.frames, spaced_s, _share_monitor(files))
            frames = list(islice(written, most + 1))
            if len(frames) <= most:
                findings += damage(video)
    except InvalidInputError as error:
        return _unusable(error.message.replace(str(files.video), "It"), error.hint)
    if not frames:
        return _unusable("No frame of it can be decoded.", "Copy the video from the camera again.")
    if len(frames) > most:
        frames = frames[:most]
        findings.append(left_out(name, frames[-1].record.name))
    return VideoTaken(video="", findings=(*findings, *findings_on_frames(track, frames)))


def spacing_within(most: int, duration_s: float | None, every_s: float) -> float:
    """The spacing at which a video has at most so many frames, ``every_s`` if it does with that."""
    if duration_s is None or duration_s < every_s * most:
        return every_s
    return max(every_s, duration_s / (most - 0.5))


def left_out(video: str, last: str) -> Finding:
    """The finding that the scene has no room for frames after the one named ``last``."""
    return Finding.of(FindingCode.FRAMES_LEFT_OUT, video=video, last=last)


def _died(video: str, last: str | None) -> VideoTaken:
    """What a video has given whose decoder died, after the frame named ``last``."""
    if last is None:
        return _unusable(
            "Decoding it took more memory or time than a video may.",
            "Convert it: ffmpeg -i VIDEO -c:v libx264 -an NEW.mp4",
        )
    return VideoTaken(video="", findings=(Finding.of(FindingCode.VIDEO_UNDECODABLE, video=video, last=last),))


def _unusable(reason: str, hint: str) -> VideoTaken:
    return VideoTaken(video="", reason=reason, hint=hint)


def _share_monitor(files: _Files) -> Monitor:
    """A monitor that writes the progress of the child into its file."""

    def write(progress: Progress) -> None:
        files.progress.write_text(f"{progress.share or 0.0:.3f}")

    return Monitor(write)
