"""Videos, by PyAV: their frames one after another, and what was recorded beside them."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import av
from av.container import InputContainer
from av.error import FFmpegError
from av.stream import Discard, Disposition
from av.video.reformatter import Colorspace
from av.video.stream import VideoStream
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.sharpness import SHARPNESS_SIDE_PX, measure_sharpness
from fvs_engine.video.dji_subtitles import read_subtitle, read_subtitles
from fvs_engine.video.gpmf import is_gpmf, read_gpmf
from fvs_engine.video.track import Record, Track
from fvs_schema.text_files import decoded_text
from fvs_schema.videos import find_subtitles

_DAMAGE = (FFmpegError, OSError)
"""What is raised for a video that is damaged, or on a disk that is."""
_FORMATS = "mov,matroska,avi,mpegts,mpeg,flv,asf,ogg,mxf,h264,hevc"
"""What is read. Photographs are no videos, and playlists and descriptions of sessions open addresses."""
_THREADS = 4
"""Threads that decode, each with frames of its own: on machines of many cores all would need gigabytes."""
_UNTOLD_COLORS = 2
"""The colour space of frames that do not tell theirs."""
_HD_WIDTH_PX = 1280
_MISSING_S = 1.0
"""How much earlier than its header says the frames of a whole video may end: its sound may be longer."""


@dataclass
class Video:
    """An open video.

    ``duration_s`` and ``began_at``, the time of day of its first frame, are those in the header, None without
    one. ``read_s`` is the end of the last frame so far; ``damaged``: something before could not be decoded.
    """

    path: Path
    container: InputContainer
    stream: VideoStream
    duration_s: float | None
    began_at: datetime | None
    read_s: float = 0.0
    damaged: bool = False

    @property
    def is_cut_short(self) -> bool:
        """Whether the last frame so far is not the last one that the header tells of."""
        return self.duration_s is not None and self.read_s < self.duration_s - _MISSING_S

    def frames(self) -> Iterator[tuple[float, av.VideoFrame]]:
        """All frames that can be decoded, with their time in s after the first.

        Few of them are in memory. Raises ``InvalidInputError`` when frames have no time.
        """
        self.stream.thread_type = "AUTO"
        self.stream.codec_context.thread_count = _THREADS
        first_s: float | None = None
        for frame in self._decoded():
            if frame.time is None or frame.time_base is None:
                raise InvalidInputError(
                    f"The frames of {self.path} have no times.",
                    hint="Put them into an MP4 file: ffmpeg -r FRAMES_PER_SECOND -i VIDEO -c copy VIDEO.mp4",
                    path=self.path,
                )
            first_s = frame.time if first_s is None else first_s
            self.read_s = frame.time - first_s + float((frame.duration or 0) * frame.time_base)
            yield frame.time - first_s, frame

    def _decoded(self) -> Iterator[av.VideoFrame]:
        packets = self.container.demux(self.stream)
        while True:
            try:
                packet = next(packets, None)
                decoded = [] if packet is None else packet.decode()
            except _DAMAGE:
                self.damaged = True
                continue
            if packet is None:
                return
            for frame in decoded:
                if frame.is_corrupt:
                    self.damaged = True
                else:
                    yield frame


@contextlib.contextmanager
def open_video(path: Path) -> Iterator[Video]:
    """Open a video; raises ``InvalidInputError`` when the file has none."""
    with _opened(path) as container:
        streams = (
            one
            for one in container.streams.video
            if one.codec_context is not None and not one.disposition & Disposition.attached_pic
        )
        stream = next(streams, None)
        if stream is None:
            raise InvalidInputError(
                f"{path} has no frames that can be decoded.",
                hint="Give a video of H.264, H.265, VP9 or AV1, or convert it: ffmpeg -i VIDEO NEW.mp4",
                path=path,
            )
        yield Video(path, container, stream, _duration_s(container, stream), _began_at(container))


def _duration_s(container: InputContainer, stream: VideoStream) -> float | None:
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    return None if container.duration is None else container.duration / av.time_base


def _began_at(container: InputContainer) -> datetime | None:
    """The time of day in the header, which is UTC without a zone."""
    try:
        began = datetime.fromisoformat(container.metadata.get("creation_time", ""))
    except ValueError:
        return None
    return began if began.tzinfo else began.replace(tzinfo=UTC)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[InputContainer]:
    try:
        file = path.open("rb")
    except OSError as error:
        raise InvalidInputError(
            f"{path} cannot be read: {error.strerror}.", hint="Give a video.", path=path
        ) from error
    with file:  # a name alone may be an address, or the name of another protocol, for FFmpeg
        try:
            options = {"format_whitelist": _FORMATS}
            container = av.open(file, "r", options=options, metadata_errors="replace")
        except _DAMAGE as error:
            file.seek(4)
            if file.read(4) == b"ftyp":
                message = f"{path} is cut short: its index, which is at the end, is missing or damaged."
                hint = "Put the card back into the camera, which may repair it, or repair it with untrunc."
            else:
                message, hint = f"{path} is not a video, or damaged.", "Give a video: MP4, MOV, MKV …"
            raise InvalidInputError(message, hint=hint, path=path) from error
        with container:
            yield container


def upright_image(frame: av.VideoFrame) -> Image.Image:
    """A frame in RGB, turned as the header of its video says.

    One of HD or more that does not say how its colours are coded has those of HD, as players have it.
    """
    turn = getattr(Image.Transpose, f"ROTATE_{frame.rotation % 360}", None)
    untold = frame.colorspace == _UNTOLD_COLORS and max(frame.width, frame.height) >= _HD_WIDTH_PX
    rgb = frame.reformat(format="rgb24", src_colorspace=Colorspace.ITU709 if untold else None)
    image = Image.fromarray(rgb.to_ndarray())
    return image if turn is None else image.transpose(turn)


def frame_sharpness(frame: av.VideoFrame) -> float:
    """The sharpness of a frame, from its brightness alone."""
    share = min(1.0, SHARPNESS_SIDE_PX / max(frame.width, frame.height))
    size = {"width": max(2, round(frame.width * share)), "height": max(2, round(frame.height * share))}
    return measure_sharpness(
        Image.fromarray(frame.reformat(**size, format="gray", interpolation="AREA").to_ndarray())
    )


def read_track(path: Path) -> Track:
    """What was recorded during a video: DJI's subtitles beside it or in it, or GoPro's metadata in it.

    Empty without any. Raises ``InvalidInputError`` when a file cannot be read.
    """
    beside = find_subtitles(path)
    found = [] if beside is None else read_subtitles(_text(beside))
    return Track(found or _embedded_records(path))


def _text(file: Path) -> str:
    try:
        content = file.read_bytes()
    except OSError as error:
        raise InvalidInputError(
            f"{file} cannot be read: {error.strerror}.", hint="Check its permissions.", path=file
        ) from error
    try:
        return decoded_text(content)
    except UnicodeDecodeError:  # of a sign of degrees or of the operator's own text
        return content.decode("latin-1")


def _embedded_records(path: Path) -> list[Record]:
    """Records in the streams of subtitles and data; those of other kinds have none."""
    records: list[Record] = []
    with _opened(path) as container:
        streams = (*container.streams.subtitles, *container.streams.data)
        for stream in container.streams:
            if stream not in streams:
                stream.discard = Discard.all  # whose bytes are then not read
        with contextlib.suppress(*_DAMAGE):  # the end of a video that is cut short
            for packet in container.demux(*streams) if streams else ():
                if packet.pts is None or packet.time_base is None:
                    continue
                content, time_s = bytes(packet), float(packet.pts * packet.time_base)
                if packet.stream.type == "data" and is_gpmf(content):
                    records += read_gpmf(content, time_s, float((packet.duration or 0) * packet.time_base))
                elif packet.stream.type == "subtitle":
                    priors = read_subtitle(content.decode("utf-8", "replace"))
                    records += [] if priors is None else [Record(time_s, priors)]
    return records
