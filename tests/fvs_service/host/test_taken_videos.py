"""Frames of videos, from the upload to images, by runner and worker without their processes."""

import hashlib
import itertools
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fvs_service.errors import StaleLeaseError
from fvs_service.host.protocol.messages import FrameTaken, VideoTaken
from fvs_service.host.runner import video_frames
from fvs_service.host.runner.video_frames import VideoFrames, spacing_within
from fvs_service.host.worker.taken_videos import TakenVideos
from videos import textured, write_video

from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.monitor import Monitor, Progress
from fvs_schema.findings import Finding, FindingCode

pytestmark = pytest.mark.process

SECONDS = 6


def srt(latitudes: list[float]) -> bytes:
    cues = (
        f"{n + 1}\n00:00:{n:02d},000 --> 00:00:{n:02d},900\n"
        f"[latitude: {latitude:.6f}] [longitude: 8.5] [rel_alt: 1.0 abs_alt: 412.0]\n"
        for n, latitude in enumerate(latitudes)
    )
    return "\n".join(cues).encode()


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A video of six seconds, a frame each, whose header says to turn it."""
    path = tmp_path_factory.mktemp("video") / "clip.mp4"
    frames = [(float(n), textured(seed=n)) for n in range(SECONDS)]
    return write_video(path, frames, turned_deg=90, created="2026-11-27T12:00:00Z").read_bytes()


def send(gateway: Any, scene: str, clip: bytes, subtitles: bytes | None = None, **metadata: Any) -> str:
    """Send a video; returns the path of its record."""
    path = f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(clip).hexdigest()}"
    if subtitles is not None:
        assert gateway.client.put(f"{path}/subtitles", content=subtitles).status_code == 204
    sent = gateway.put(scene, clip, **{"name": "DJI_0001.MP4", **metadata})
    assert sent.json()["verdict"] == "video", sent.text
    return path


def take(
    gateway: Any, scene: str, monitor: Monitor | None = None, dies_after: int | None = None
) -> list[dict[str, Any]]:
    """Run the scene's job until it ends, or its worker dies after so many messages; returns the warnings."""
    storage = gateway.application.storage
    found = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
    job_id = next(job["id"] for job in found if job["kind"] == "frames" and job["state"] != "succeeded")
    lease = gateway.lease(scene)
    job = storage.ledger.start(lease, job_id, 1)
    runner = VideoFrames(storage.settings.scenes / scene, storage.blobs, 60.0)
    messages = 0
    try:
        with TakenVideos(storage, lease, job) as taken:

            def record(message: Any) -> None:
                nonlocal messages
                if messages == dies_after:
                    raise ConnectionError
                messages += 1
                taken.record(message)

            runner.take(taken.request(), monitor or Monitor(), record)
        warnings = gateway.client.get(f"/v1/jobs/{job_id}").json()["warnings"]
        storage.ledger.succeed(lease, job_id)
        return warnings
    finally:
        storage.leases.release(lease)


def frames(gateway: Any, scene: str) -> list[dict[str, Any]]:
    images = gateway.client.get(f"/v1/scenes/{scene}/images", params={"limit": 100}).json()["items"]
    return [image for image in images if image["verdict"] != "video"]


def kept(gateway: Any, scene: str) -> set[str]:
    gateway.application.storage.removals.run()
    folder: Path = gateway.settings.root / "blobs" / "scenes" / scene
    return {file.parent.name for file in folder.rglob("*") if file.is_file()}


@pytest.mark.system
def test_frames_become_images_with_time_and_position(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene(policy={"trigger": "each-image", "first": 2})
    video = send(gateway, scene, clip, srt([47.0 + 0.001 * n for n in range(SECONDS)]), every_s=2.0)
    told: list[Progress] = []
    assert take(gateway, scene, Monitor(told.append)) == []
    images = frames(gateway, scene)
    assert [image["name"] for image in images] == [
        f"DJI_0001_00h00m0{second}.000s.jpg" for second in (0, 2, 4)
    ]
    assert {image["verdict"] for image in images} == {"accepted"}
    assert {(image["width_px"], image["height_px"]) for image in images} == {(48, 64)}
    latitudes = [image["prior"]["latitude_deg"] for image in images]
    assert latitudes == pytest.approx([47.0, 47.002, 47.004], abs=1e-6)
    assert images[1]["captured_at"].startswith("2026-11-27T12:00:02")
    record = gateway.client.get(video).json()
    assert (record["verdict"], record["frames"]) == ("video", 3)
    assert {image["video"] for image in images} == {record["digest"]}
    assert kept(gateway, scene) == {"images", "thumbnails"}
    kinds = [job["kind"] for job in gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]]
    assert sorted(kinds) == ["frames", "update"]  # the one of the policy
    assert all(earlier.done <= later.done for earlier, later in itertools.pairwise(told))
    assert send(gateway, scene, clip) == video  # again
    assert len(frames(gateway, scene)) == 3


@pytest.mark.system
def test_a_worker_that_dies_loses_no_frame_and_none_is_stored_twice(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    video = send(gateway, scene, clip)
    with pytest.raises(ConnectionError):
        take(gateway, scene, dies_after=2)
    assert len(frames(gateway, scene)) == 2
    assert (gateway.client.get(video).json()["frames"], kept(gateway, scene)) == (
        None,
        {"images", "thumbnails", "videos"},
    )
    warnings = take(gateway, scene)
    assert [warning["code"] for warning in warnings] == ["frames-without-position"]
    images = frames(gateway, scene)
    assert set(warnings[0]["images"]) == {image["digest"] for image in images}
    assert len({image["name"] for image in images}) == len(images) == SECONDS
    assert gateway.client.get(video).json()["frames"] == SECONDS


@pytest.mark.system
def test_frames_are_spaced_wider_where_the_scene_has_less_room(
    open_gateway: Callable[..., Any], clip: bytes, photograph: Callable[..., bytes]
) -> None:
    gateway = open_gateway(limits={"images_per_scene": 4})
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    send(gateway, scene, clip)
    codes = {warning["code"]: warning for warning in take(gateway, scene)}
    assert codes["frames-spaced-wider"]["numbers"]["room"] == 3
    assert 1 < len(frames(gateway, scene)) <= 4
    while gateway.put(scene, photograph(len(frames(gateway, scene)) + 5)).status_code == 201:
        pass
    late = gateway.put(scene, clip + b"\0" * 8, name="b.mp4")
    assert (late.status_code, late.json()["code"]) == (409, "conflict")


@pytest.mark.system
def test_equal_frames_are_one_image_and_take_the_room_of_one(
    open_gateway: Callable[..., Any], clip: bytes, tmp_path: Path
) -> None:
    gateway = open_gateway(limits={"images_per_scene": 4})
    scene = gateway.scene()
    grey = np.full((48, 64, 3), 90, np.uint8)
    path = write_video(tmp_path / "still.mp4", [(float(n), grey) for n in range(4)])
    still = send(gateway, scene, path.read_bytes(), name="still.mp4")
    send(gateway, scene, clip, every_s=2.0)
    warning, *_ = take(gateway, scene)
    assert warning["message"].startswith("4 of 4 frames have no position: still_00h00m00.000s.jpg, ")
    assert len(warning["images"]) == 1
    assert gateway.client.get(still).json()["frames"] == 1
    assert len(frames(gateway, scene)) == 4


@pytest.mark.system
def test_a_long_name_is_cut_in_those_of_its_frames(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    video = send(gateway, scene, clip, name="ü" * 250 + ".mp4", every_s=2.0)
    take(gateway, scene)
    assert gateway.client.get(video).json()["frames"] == 3
    assert {image["name"] for image in frames(gateway, scene)} == {
        "ü" * 90 + f"_00h00m0{second}.000s.jpg" for second in (0, 2, 4)
    }


@pytest.mark.system
def test_a_full_scene_keeps_the_video(
    open_gateway: Callable[..., Any], clip: bytes, photograph: Callable[..., bytes]
) -> None:
    gateway = open_gateway(limits={"images_per_scene": 1})
    scene = gateway.scene()
    video = send(gateway, scene, clip)
    image = gateway.put(scene, photograph(1)).json()
    with pytest.raises(InvalidInputError, match="no room"):
        take(gateway, scene)
    assert "videos" in kept(gateway, scene)
    gateway.client.delete(f"/v1/scenes/{scene}/images/{image['digest']}")
    take(gateway, scene)
    assert gateway.client.get(video).json()["frames"] == 1


@pytest.mark.system
def test_what_can_be_read_of_a_damaged_video_is_used(gateway: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    seconds = [(float(n), textured(seed=n)) for n in range(6)]
    whole = write_video(path, seconds, index_first=True).read_bytes()
    scene = gateway.scene()
    video = send(gateway, scene, whole[: len(whole) * 2 // 3])
    codes = {warning["code"]: warning for warning in take(gateway, scene)}
    assert codes["video-damaged"]["message"].startswith("DJI_0001.MP4 is damaged or cut short")
    assert 1 <= gateway.client.get(video).json()["frames"] < 6

    video = send(gateway, scene, whole[: whole.index(b"mdat") + 40], name="b.mp4")
    with pytest.raises(InvalidInputError, match=r"^b\.mp4: No frame of it"):
        take(gateway, scene)
    record = gateway.client.get(video).json()
    assert (record["verdict"], record["reason"]) == ("unreadable", "No frame of it can be decoded.")
    assert kept(gateway, scene) == {"images", "thumbnails"}


@pytest.mark.system
def test_a_decoder_that_dies_costs_its_video_alone(
    gateway: Any, clip: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    video = send(gateway, scene, clip)
    monkeypatch.setattr(video_frames, "_write_frames", _die)
    with pytest.raises(InvalidInputError, match="more memory or time"):
        take(gateway, scene)
    assert gateway.client.get(video).json()["verdict"] == "unreadable"


def _die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.system
def test_taking_frames_can_be_canceled(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    video = send(gateway, scene, clip)
    monitor = Monitor()
    monitor.cancel()
    with pytest.raises(Cancelled):
        take(gateway, scene, monitor)
    assert gateway.client.get(video).json()["frames"] is None


def test_frames_of_a_video_that_was_deleted_meanwhile_are_not_stored(
    gateway: Any, clip: bytes, photograph: Callable[..., bytes], tmp_path: Path
) -> None:
    scene = gateway.scene()
    video = send(gateway, scene, clip)
    digest = video.rpartition("/")[2]
    storage, lease = gateway.application.storage, gateway.lease(scene)
    queued = {of: job for job, of in gateway.queued_jobs().items()}
    job = storage.ledger.start(lease, queued[scene], 1)
    with TakenVideos(storage, lease, job) as taken:
        for number, name in enumerate(("a.jpg", "b.jpg")):
            (tmp_path / name).write_bytes(photograph(number))
            taken.record(FrameTaken(video=digest, name=name, file=str(tmp_path / name)))
            gateway.client.delete(video)
        blurred = Finding.of(FindingCode.FRAMES_BLURRED, ["b.jpg"], of=2)
        taken.record(VideoTaken(video=digest, findings=(blurred,)))
    assert [image["name"] for image in frames(gateway, scene)] == ["a.jpg"]
    assert gateway.client.get(f"/v1/jobs/{job.id}").json()["warnings"] == []


def test_a_frame_of_a_deleted_scene_ends_the_start(gateway: Any, clip: bytes, tmp_path: Path) -> None:
    scene = gateway.scene()
    digest = send(gateway, scene, clip).rpartition("/")[2]
    storage, lease = gateway.application.storage, gateway.lease(scene)
    queued = {of: job for job, of in gateway.queued_jobs().items()}
    job = storage.ledger.start(lease, queued[scene], 1)
    (tmp_path / "a.jpg").write_bytes(b"a frame")
    with TakenVideos(storage, lease, job) as taken:
        assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 204
        with pytest.raises(StaleLeaseError):
            taken.record(FrameTaken(video=digest, name="a.jpg", file=str(tmp_path / "a.jpg")))


@pytest.mark.parametrize(
    ("most", "duration_s", "every_s", "spaced_s"),
    [(10, 9.9, 1.0, 1.0), (10, 10.0, 1.0, 10 / 9.5), (1, 60.0, 1.0, 120.0), (5, None, 1.0, 1.0)],
    ids=["room for all", "one too many", "room for one", "unknown length"],
)
def test_the_spacing_leaves_room(most: int, duration_s: float, every_s: float, spaced_s: float) -> None:
    assert spacing_within(most, duration_s, every_s) == pytest.approx(spaced_s)
    if duration_s is not None:
        assert duration_s // spaced_s + 1 <= most
