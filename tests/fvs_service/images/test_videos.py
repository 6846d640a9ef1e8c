import base64
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fvs_service.images import videos
from videos import textured, write_video

SRT = b"1\n00:00:00,000 --> 00:00:01,000\n[latitude: 47.5] [longitude: 8.5] [rel_alt: 1 abs_alt: 400]\n"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A video of two seconds."""
    path = tmp_path_factory.mktemp("video") / "DJI_0001.MP4"
    return write_video(path, [(0.5 * n, textured(seed=n)) for n in range(4)]).read_bytes()


def path_of(scene: str, content: bytes, what: str = "") -> str:
    return f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(content).hexdigest()}{what}"


def kept(gateway: Any, scene: str) -> list[str]:
    """The kinds of blobs that the service keeps for a scene, after all removals that are due."""
    gateway.application.storage.removals.run()
    folder: Path = gateway.settings.root / "blobs" / "scenes" / scene
    return sorted(file.parent.name for file in folder.rglob("*") if file.is_file())


def jobs(gateway: Any, scene: str) -> list[tuple[str, str]]:
    found = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
    return [(job["kind"], job["state"]) for job in found]


def test_a_video_is_kept_and_a_job_is_queued_for_its_frames(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    made = gateway.put(scene, clip, name="DJI_0001.MP4", every_s=0.5)
    assert made.status_code == 201, made.text
    image = made.json()
    assert (image["verdict"], image["registration"]) == ("video", "unused")
    assert (image["every_s"], image["frames"], image["format"]) == (0.5, None, "MOV")
    assert (image["width_px"], image["height_px"]) == (64, 48)
    assert gateway.put(scene, clip, name="DJI_0001.MP4").json() == image  # again
    assert jobs(gateway, scene) == [("frames", "queued")]
    assert kept(gateway, scene) == ["videos"]
    counts = gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]
    assert {counts["received"], counts["rejected"], counts["pending"]} == {0}
    size = gateway.client.get(f"/v1/scenes/{scene}/size").json()
    assert size["images_bytes"] == len(clip)


def test_a_video_resumes_over_tus(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    fields = {"scene": scene, "sha256": hashlib.sha256(clip).hexdigest(), "filename": "flight.mov"}
    encoded = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in fields.items())
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": str(len(clip)), "Upload-Metadata": encoded}
    upload = gateway.client.post("/v1/uploads", headers=headers).headers["location"]
    for start in (0, 1000):
        part = clip[start : 1000 if start == 0 else None]
        headers = {
            "Tus-Resumable": "1.0.0",
            "Upload-Offset": str(start),
            "Content-Type": "application/offset+octet-stream",
        }
        answer = gateway.client.patch(upload, content=part, headers=headers)
        assert answer.status_code == 204, answer.text
    image = gateway.client.get(answer.headers["content-location"]).json()
    assert (image["name"], image["verdict"], image["every_s"]) == ("flight.mov", "video", 1.0)


def test_subtitles_go_before_their_video_and_with_it(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    for _ in range(2):
        answer = gateway.client.put(path_of(scene, clip, "/subtitles"), content=SRT)
        assert answer.status_code == 204, answer.text
    assert kept(gateway, scene) == ["subtitles"]
    gateway.put(scene, clip, name="a.mp4")
    late = gateway.client.put(path_of(scene, clip, "/subtitles"), content=SRT)
    assert (late.status_code, late.json()["code"]) == (409, "conflict")
    assert kept(gateway, scene) == ["subtitles", "videos"]
    assert gateway.client.delete(path_of(scene, clip)).status_code == 204
    assert kept(gateway, scene) == []


def test_a_photograph_has_no_subtitles(gateway: Any, photograph: Callable[..., bytes]) -> None:
    scene, content = gateway.scene(), photograph(1)
    gateway.put(scene, content, name="a.jpg")
    answer = gateway.client.put(path_of(scene, content, "/subtitles"), content=SRT)
    assert (answer.status_code, answer.json()["detail"]) == (409, "a.jpg is no video, and has no subtitles.")


def test_deleting_a_scene_deletes_its_video(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    gateway.put(scene, clip, name="a.mp4")
    assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 204
    assert kept(gateway, scene) == []


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda clip: clip[: len(clip) // 2], "its index"),
        (lambda _clip: b"no video" * 40, "not a video"),
        (lambda _clip: b"", "not a video"),
    ],
    ids=["cut short", "something else", "empty"],
)
def test_what_is_no_video_is_unreadable(
    gateway: Any, clip: bytes, damage: Callable[[bytes], bytes], reason: str
) -> None:
    scene = gateway.scene()
    image = gateway.put(scene, damage(clip), name="a.mp4").json()
    assert image["verdict"] == "unreadable"
    assert reason in image["reason"]
    assert image["hint"]
    assert str(gateway.settings.root) not in image["reason"]
    assert (jobs(gateway, scene), kept(gateway, scene)) == ([], [])


def test_a_video_has_limits_of_its_own(open_gateway: Callable[..., Any], clip: bytes) -> None:
    limits = {"image_bytes": len(clip) - 1, "video_bytes": len(clip), "video_s": 1.0}
    gateway = open_gateway(limits=limits)
    scene = gateway.scene()
    assert gateway.put(scene, clip, name="a.jpg").status_code == 413
    assert gateway.put(scene, clip + b" ", name="a.mp4").status_code == 413
    long = gateway.put(scene, clip, name="a.mp4").json()
    assert (long["verdict"], long["reason"]) == ("too-large", "It is 2 s long, and videos may have 1 s.")


@pytest.mark.parametrize(
    ("metadata", "field"),
    [({"name": "a.mp4", "yaw_deg": 10.0}, "yaw_deg"), ({"name": "a.jpg", "every_s": 2.0}, "every_s")],
    ids=["attitude of a video", "spacing of a photograph"],
)
def test_metadata_are_those_of_the_kind(
    gateway: Any, clip: bytes, metadata: dict[str, Any], field: str
) -> None:
    refused = gateway.put(gateway.scene(), clip, **metadata)
    assert refused.status_code == 422
    assert [error["field"] for error in refused.json()["errors"]] == [field]


def test_a_service_without_pyav_says_so(gateway: Any, clip: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(videos, "find_spec", lambda _name: None)
    refused = gateway.put(gateway.scene(), clip, name="a.mp4")
    assert refused.status_code == 415
    assert "extra `video`" in refused.json()["hint"]


def test_frames_are_asked_for_only_while_a_video_waits(gateway: Any, clip: bytes) -> None:
    scene = gateway.scene()
    refused = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "frames"})
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    gateway.put(scene, clip, name="a.mp4")
    queued = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "frames"})
    assert queued.status_code == 202
    assert jobs(gateway, scene) == [("frames", "queued")]
    wrong = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "frames", "iterations": 9})
    assert wrong.status_code == 422
