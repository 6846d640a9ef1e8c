"""Which files are videos, and where their subtitles are, for the engine, the service and the client."""

from pathlib import Path, PurePosixPath

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".m2ts"})
"""Files that the service takes for videos, by the ends of their names in lower case."""


_STEM_BYTES = 180


def frame_stem(name: str) -> str:
    """What names of frames begin with: the video's without suffix, cut so that they can be names of files."""
    return PurePosixPath(name).stem.encode()[:_STEM_BYTES].decode(errors="ignore")


def is_video(name: str) -> bool:
    """Whether the file of this name is a video."""
    return PurePosixPath(name).suffix.lower() in VIDEO_SUFFIXES


def find_subtitles(video: Path) -> Path | None:
    """The file with DJI's subtitles beside a video, ``VIDEO.SRT``; None without one."""
    beside = (video.with_suffix(suffix) for suffix in (".SRT", ".srt"))
    return next((file for file in beside if file.is_file()), None)
