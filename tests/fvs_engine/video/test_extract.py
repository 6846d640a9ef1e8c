import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from av import VideoFrame
from av.video.reformatter import Colorspace
from PIL import Image
from videos import blurred, gps5, textured, write_video

from fvs_engine.errors import Cancelled, InvalidInputError, OutputExistsError
from fvs_engine.images.metadata import PhotographPriors, read_priors
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.video.extract import extract_frames
from fvs_engine.video.reading import upright_image
from fvs_schema.findings import Finding, FindingCode

TIMES = [number / 10 for number in range(21)]
SUBTITLE = (
    "[latitude: {:.6f}] [longitude: 8.5] [rel_alt: 1.0 abs_alt: 412.5] "
    "[gb_yaw: 30.0 gb_pitch: -20.5 gb_roll: 0.0]"
)


def _extracted(video: Path, every_s: float = 1.0) -> tuple[list[Path], list[Finding]]:
    findings: list[Finding] = []
    paths = extract_frames(video, video.parent / "frames", every_s, Monitor(on_warning=findings.append))
    return paths, findings


def _priors(path: Path) -> PhotographPriors:
    with path.open("rb") as file:
        return read_priors(file)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Two seconds, of which frames 9 and 10 alone are sharp around the first one."""
    frames = [(time, textured(seed=number)) for number, time in enumerate(TIMES)]
    frames[8:13] = [(time, blurred(pixels) if time > 0.95 else pixels) for time, pixels in frames[8:13]]
    return write_video(tmp_path / "DJI 0001.MP4", frames, created="2026-11-27T12:00:00.000000Z")


def test_names_tell_the_time_of_sharp_frames(video: Path) -> None:
    paths, _ = _extracted(video)
    assert len(paths) == 3
    assert paths[1].name in ("DJI 0001_00h00m00.800s.jpg", "DJI 0001_00h00m00.900s.jpg")
    listed = json.loads((video.parent / "frames" / "frames.json").read_text())
    assert [frame["name"] for frame in listed["frames"]] == [path.name for path in paths]
    assert f"{_priors(paths[1]).captured_at:%H:%M:%S.%f}".startswith(
        f"12:00:0{listed['frames'][1]['time_s']:.1f}"
    )


def test_subtitles_beside_the_video_become_metadata_of_photographs(video: Path) -> None:
    cues = [f"{n}\n00:00:0{n},000 --> 00:00:0{n + 1},000\n{SUBTITLE.format(47 + n / 10)}\n" for n in range(3)]
    video.with_suffix(".SRT").write_text("\n".join(cues), encoding="utf-16")
    paths, findings = _extracted(video)
    assert findings == []
    time_s = json.loads((video.parent / "frames" / "frames.json").read_text())["frames"][1]["time_s"]
    priors = _priors(paths[1])
    assert priors.latitude_deg == pytest.approx(47 + time_s / 10, abs=1e-8)
    assert (priors.longitude_deg, priors.altitude_m) == pytest.approx((8.5, 412.5))
    assert (priors.yaw_deg, priors.pitch_deg, priors.roll_deg) == (30.0, -20.5, 0.0)


def test_subtitles_and_gpmf_in_the_video_are_read(tmp_path: Path) -> None:
    frames = [(time, textured()) for time in TIMES]
    texts = [SUBTITLE.format(47 + number / 10) for number in range(3)]
    gpmf = [gps5([(47 + number / 10, 8.5, 412.5)]) for number in range(3)]
    for folder, beside in (("dji", {"subtitles": texts}), ("gopro", {"gpmf": gpmf})):
        (tmp_path / folder).mkdir()
        paths, findings = _extracted(write_video(tmp_path / folder / "one.mp4", frames, **beside))
        above_ellipsoid = [FindingCode.FRAMES_ABOVE_ELLIPSOID] if folder == "gopro" else []
        assert [finding.code for finding in findings] == above_ellipsoid
        latitudes = [_priors(path).latitude_deg for path in paths]
        assert latitudes == pytest.approx([47.0, 47.1, 47.2], abs=0.03)


def test_without_positions_it_says_so(video: Path) -> None:
    paths, findings = _extracted(video)
    assert [finding.code for finding in findings] == [FindingCode.FRAMES_WITHOUT_POSITION]
    assert findings[0].images == tuple(path.name for path in paths)


def test_heights_over_the_start_alone_are_not_taken_for_altitudes(video: Path) -> None:
    video.with_suffix(".srt").write_text("1\n00:00:00,000 --> 00:00:01,000\nGPS(8.5,47.1,14) BAROMETER:4.5\n")
    paths, findings = _extracted(video)
    assert [finding.code for finding in findings] == [
        FindingCode.FRAMES_WITHOUT_POSITION,
        FindingCode.FRAMES_WITHOUT_ALTITUDE,
    ]
    assert (_priors(paths[0]).latitude_deg, _priors(paths[0]).altitude_m) == (pytest.approx(47.1), None)


@pytest.mark.parametrize(
    ("turned_deg", "corner"), [(0, (0, 0)), (90, (0, -1)), (-90, (-1, 0)), (180, (-1, -1))]
)
def test_frames_are_turned_as_the_header_says(
    tmp_path: Path, turned_deg: int, corner: tuple[int, int]
) -> None:
    pixels = np.zeros((48, 64, 3), np.uint8)
    pixels[:20, :20] = 255  # the corner at the upper left
    (path,), _ = _extracted(write_video(tmp_path / "one.mp4", [(0.0, pixels)], turned_deg=turned_deg))
    with Image.open(path) as image:
        assert image.size == ((64, 48) if turned_deg % 180 == 0 else (48, 64))
        across, down = corner
        assert image.getpixel((across % image.width, down % image.height)) > (200, 200, 200)


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize(("width", "coded"), [(1280, Colorspace.ITU709), (640, Colorspace.ITU601)])
def test_colours_are_those_of_the_size_unless_the_video_tells(
    width: int, coded: Colorspace, told: bool
) -> None:
    pixels = np.full((32, width, 3), (40, 180, 60), np.uint8)
    frame = VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv420p", dst_colorspace=coded)
    frame.colorspace = {Colorspace.ITU709: 1, Colorspace.ITU601: 5}[coded] if told else 2
    assert upright_image(frame).getpixel((9, 9)) == pytest.approx((40, 180, 60), abs=3)


def test_frames_of_a_variable_rate_have_their_own_times(tmp_path: Path) -> None:
    times = [0.0, 0.04, 1.0, 3.6, 3.64, 4.0]
    paths, findings = _extracted(
        write_video(tmp_path / "one.mp4", [(time, textured()) for time in times]), 2.0
    )
    assert [finding.code for finding in findings] == [FindingCode.FRAMES_WITHOUT_POSITION]
    assert paths[0].name.removeprefix("one_00h00m0") in ("0.000s.jpg", "0.040s.jpg")
    assert paths[-1].name.removeprefix("one_00h00m0") in ("3.600s.jpg", "3.640s.jpg", "4.000s.jpg")


def test_of_a_video_that_is_cut_short_the_rest_is_used(tmp_path: Path) -> None:
    frames = [(number / 10, textured(240, 320, seed=number)) for number in range(60)]
    video = write_video(tmp_path / "whole.mp4", frames, index_first=True)
    content = video.read_bytes()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(content[: len(content) // 2])
    paths, findings = _extracted(cut)
    assert 3 <= len(paths) <= 4
    damaged = findings[0]
    assert damaged.code is FindingCode.VIDEO_DAMAGED
    assert 2.0 < damaged.numbers["read_s"] < 4.0


_SESSION = b"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 39998 RTP/AVP 96\n"
"""A description of a session, for which FFmpeg would open ports."""


def _photograph(path: Path) -> None:
    Image.fromarray(textured()).save(path, format="JPEG")


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda video: video.write_bytes(video.read_bytes()[:3000]), "cut short"),
        (lambda video: video.write_bytes(b"no video"), "not a video"),
        (lambda video: video.write_bytes(b""), "not a video"),
        (lambda video: video.write_bytes(_SESSION + b"a=rtpmap:96 H264/90000\n"), "not a video"),
        (_photograph, "not a video"),
        (lambda video: video.write_bytes(video.read_bytes().replace(b"avc1", b"none")), "no frames that"),
        (lambda video: video.unlink(), "cannot be read: No such file"),
        (lambda video: video.unlink() or video.mkdir(), "cannot be read: Is a directory"),
    ],
)
def test_what_is_no_video_is_refused_with_the_reason(
    video: Path, spoil: Callable[[Path], None], reason: str
) -> None:
    spoil(video)
    with pytest.raises(InvalidInputError, match=reason):
        extract_frames(video, video.parent / "frames", 1.0, Monitor())
    assert not (video.parent / "frames").exists()


def test_a_stopped_call_is_repeated_and_another_video_is_refused(video: Path) -> None:
    frames = video.parent / "frames"

    def stop(progress: Progress) -> None:
        if progress.done == 1:
            monitor.cancel()

    monitor = Monitor(stop)
    with pytest.raises(Cancelled):
        extract_frames(video, frames, 1.0, monitor)
    paths, _ = _extracted(video)
    assert len(paths) == 3
    changed = paths[0].stat().st_mtime_ns
    assert extract_frames(video, frames, 1.0, Monitor()) == paths
    assert paths[0].stat().st_mtime_ns == changed
    with pytest.raises(OutputExistsError, match="every_s"):
        extract_frames(video, frames, 0.5, Monitor())
    shutil.rmtree(frames)
    frames.mkdir()
    (frames / "mine.jpg").touch()
    with pytest.raises(OutputExistsError):
        extract_frames(video, frames, 1.0, Monitor())
