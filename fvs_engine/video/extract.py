"""Frames of a video as JPEGs in a folder, each with its time in its name and its priors in its metadata."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

from av import VideoFrame

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import replacing
from fvs_engine.files.owned_folder import OwnedFolder, differences
from fvs_engine.images.metadata import PhotographPriors
from fvs_engine.images.sharpness import SHARP
from fvs_engine.images.written_priors import prior_tags
from fvs_engine.monitor import Monitor
from fvs_engine.records import Record
from fvs_engine.video.reading import Video, frame_sharpness, open_video, read_track, upright_image
from fvs_engine.video.sharp_frames import choose_sharp_frames
from fvs_engine.video.track import Track
from fvs_schema.findings import Finding, FindingCode, Severity
from fvs_schema.stages import Stage
from fvs_schema.videos import frame_stem

RECORD_FILE = "frames.json"
_JPEG_QUALITY = 95


class FrameRecord(Record):
    """A frame in the folder: its file, its time after the first frame of the video, and its sharpness."""

    name: str
    time_s: float
    sharpness: float


class FramesRecord(Record):
    """The frames of a video; None until all of them are written."""

    video: str
    video_bytes: int
    every_s: float
    frames: tuple[FrameRecord, ...] | None = None


def extract_frames(video: Path, out: Path, every_s: float, monitor: Monitor) -> list[Path]:
    """Write the sharpest frame around each multiple of ``every_s`` into the folder ``out``.

    A name has the time after the first frame, ``VIDEO_00h01m02.500s.jpg``; ``frames.json`` lists them. EXIF
    and XMP have position, attitude and time of day where the video, or the file beside it, has them. Warns of
    frames without positions and of blurred ones, and of a damaged video. A call that was stopped can be
    repeated. Raises ``InvalidInputError`` when the video cannot be used, ``OutputExistsError`` when the
    folder has something else, ``StorageError``, and ``Cancelled``.
    """
    with open_video(video) as opened:
        wanted = FramesRecord(video=video.name, video_bytes=video.stat().st_size, every_s=every_s)
        folder = OwnedFolder(out, RECORD_FILE, FramesRecord, "set of frames")
        folder.create()
        there = folder.read()
        if there is not None:
            same = {"frames"}
            folder.require_same(differences(there.model_dump(exclude=same), wanted.model_dump(exclude=same)))
        if there is not None and there.frames is not None:
            return [out / frame.name for frame in there.frames]
        folder.write(wanted)
        track = read_track(opened.path)
        frames = list(written_frames(opened, track, out, every_s, monitor))
    if not frames:
        raise InvalidInputError(
            f"No frame of {video} can be decoded.", hint="Copy the video from the camera again.", path=video
        )
    folder.write(wanted.model_copy(update={"frames": tuple(frame.record for frame in frames)}))
    for finding in (*damage(opened), *findings_on_frames(track, frames)):
        monitor.warn(finding)
    return [out / frame.record.name for frame in frames]


@dataclass(frozen=True)
class Frame:
    """A frame that is a JPEG now, with the priors in it."""

    record: FrameRecord
    priors: PhotographPriors


def written_frames(
    video: Video, track: Track, out: Path, every_s: float, monitor: Monitor
) -> Iterator[Frame]:
    """Write the frames of ``extract_frames`` one after another; their files are whole when they appear."""
    for chosen in choose_sharp_frames(_watched_frames(video, monitor), every_s, frame_sharpness):
        record = FrameRecord(
            name=f"{frame_stem(video.path.name)}_{_clock(chosen.time_s)}.jpg",
            time_s=chosen.time_s,
            sharpness=chosen.sharpness,
        )
        priors = track.at(chosen.time_s)
        if priors.captured_at is None and video.began_at is not None:
            priors = replace(priors, captured_at=video.began_at + timedelta(seconds=chosen.time_s))
        exif, xmp = prior_tags(priors)
        with replacing(out / record.name) as temporary:
            upright_image(chosen.frame).save(
                temporary, format="JPEG", quality=_JPEG_QUALITY, exif=exif, xmp=xmp
            )
        yield Frame(record, priors)


def _watched_frames(video: Video, monitor: Monitor) -> Iterator[tuple[float, VideoFrame]]:
    total_s = None if video.duration_s is None else round(video.duration_s)
    for time_s, frame in video.frames():
        monitor.check()
        monitor.report(
            Stage.FRAMES, round(time_s) if total_s is None else min(round(time_s), total_s), total_s
        )
        yield time_s, frame


def _clock(time_s: float) -> str:
    minutes, milliseconds = divmod(round(time_s * 1000), 60_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}h{minutes:02d}m{milliseconds // 1000:02d}.{milliseconds % 1000:03d}s"


def damage(video: Video) -> Iterator[Finding]:
    """The finding on a video that could not be read as a whole."""
    if video.damaged or video.is_cut_short:
        yield Finding.of(FindingCode.VIDEO_DAMAGED, video=video.path.name, read_s=video.read_s)


def findings_on_frames(track: Track, frames: Sequence[Frame]) -> Iterator[Finding]:
    """The findings on frames that are blurred, or have no position or altitude."""
    blurred = [frame.record.name for frame in frames if frame.record.sharpness < SHARP]
    without = [frame.record.name for frame in frames if frame.priors.latitude_deg is None]
    high = [frame.record.name for frame in frames if frame.priors.altitude_m is not None]
    flat = [
        frame.record.name
        for frame in frames
        if frame.priors.latitude_deg is not None and frame.priors.altitude_m is None
    ]
    if blurred:
        yield Finding.of(FindingCode.FRAMES_BLURRED, blurred, of=len(frames))
    if without:
        yield Finding.of(FindingCode.FRAMES_WITHOUT_POSITION, without, Severity.NOTE, of=len(frames))
    if flat:
        yield Finding.of(FindingCode.FRAMES_WITHOUT_ALTITUDE, flat, of=len(frames))
    if high and track.is_above_ellipsoid:
        yield Finding.of(FindingCode.FRAMES_ABOVE_ELLIPSOID, high, of=len(frames))
