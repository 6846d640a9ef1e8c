import hashlib
import json
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Client, DamagedDownloadError, DownloadProgress, NotFoundError, Retries, Snapshot

CONTENT = bytes(range(256)) * 4096
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def snapshot(client: Client, gateway: Any) -> Snapshot:
    scene = client.scenes.create("quarry")
    gateway.model(scene.id)
    latest = scene.snapshots.latest()
    assert latest is not None
    return latest


def test_a_file_arrives_whole_and_only_once(snapshot: Snapshot, tmp_path: Path) -> None:
    seen: list[DownloadProgress] = []
    path = snapshot.download("point_cloud.ply", tmp_path, on_progress=seen.append)
    artifact = next(item for item in snapshot.artifacts if item.name == "point_cloud.ply")
    assert path == tmp_path / "point_cloud.ply"
    assert hashlib.sha256(path.read_bytes()).hexdigest() == artifact.sha256
    assert seen[-1].bytes_done == seen[-1].bytes_total == artifact.size_bytes
    assert [file.name for file in tmp_path.iterdir()] == ["point_cloud.ply"]
    seen.clear()
    assert snapshot.download("point_cloud.ply", path, on_progress=seen.append) == path
    assert not seen
    path.write_bytes(b"something else")
    snapshot.download("point_cloud.ply", path)
    assert hashlib.sha256(path.read_bytes()).hexdigest() == artifact.sha256


def test_a_new_folder_is_made(snapshot: Snapshot, tmp_path: Path) -> None:
    file = snapshot.download("cameras.json", tmp_path / "deep" / "cameras.json")
    artifact = next(item for item in snapshot.artifacts if item.name == "cameras.json")
    assert hashlib.sha256(file.read_bytes()).hexdigest() == artifact.sha256


def test_cameras_are_read(snapshot: Snapshot) -> None:
    cameras = snapshot.cameras()
    assert len(cameras.views) == 6
    assert cameras.camera.width_px == 32


def test_a_missing_file_is_named(snapshot: Snapshot, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match=r"model\.obj") as caught:
        snapshot.download("model.obj", tmp_path)
    assert "cameras.json" in caught.value.hint


def serving(handler: Any, start: int, stop: int, *, declared: int | None = None) -> None:
    """Serve bytes of ``CONTENT``, and hang up if more were declared."""
    handler.send_response(206 if start else 200)
    handler.send_header("ETag", f'"{SHA256}"')
    if start:
        handler.send_header("Content-Range", f"bytes {start}-{len(CONTENT) - 1}/{len(CONTENT)}")
    handler.send_header("Content-Length", str(declared if declared is not None else stop - start))
    handler.end_headers()
    handler.wfile.write(CONTENT[start:stop])
    if declared is not None:
        handler.wfile.flush()
        handler.connection.shutdown(socket.SHUT_RDWR)
        handler.close_connection = True


def breaking_after(size: int) -> Callable[[Any], None]:
    def act(handler: Any) -> None:
        start = int(handler.headers.get("Range", "bytes=0-").removeprefix("bytes=").rstrip("-"))
        rest = len(CONTENT) - start
        if rest <= size:
            serving(handler, start, len(CONTENT))
        else:
            serving(handler, start, start + size, declared=rest)

    return act


@pytest.fixture
def large(snapshot: Snapshot, script: Any) -> Any:
    """The snapshot with one file, of ``CONTENT``, that the misbehaving server has."""
    document = json.loads(snapshot.model_dump_json())
    document["artifacts"] = [
        {"name": "big.bin", "media_type": "x/y", "size_bytes": len(CONTENT), "sha256": SHA256}
    ]
    client = Client(script.url, retries=Retries(attempts=2, first_s=0.0))
    yield Snapshot.model_validate(document, context={"session": client._session})
    client.close()


def test_a_broken_download_goes_on_where_it_ended(large: Snapshot, script: Any, tmp_path: Path) -> None:
    script.acts = [breaking_after(200_000)]
    path = large.download("big.bin", tmp_path)
    assert path.read_bytes() == CONTENT
    ranges = [headers.get("range") for _, _, headers, _ in script.requests]
    assert ranges[0] is None
    starts = [int(header.removeprefix("bytes=").rstrip("-")) for header in ranges[1:] if header]
    assert starts == [200_000 * number for number in range(1, 6)]
    assert all(headers["if-range"] == f'"{SHA256}"' for _, _, headers, _ in script.requests[1:])
    assert [file.name for file in tmp_path.iterdir()] == ["big.bin"]


def test_another_process_goes_on_too(large: Snapshot, script: Any, tmp_path: Path) -> None:
    script.acts = [breaking_after(0)]
    part = tmp_path / f".big.bin.{SHA256[:12]}.part"
    part.write_bytes(CONTENT[:700_000])
    script.acts = [breaking_after(len(CONTENT))]
    large.download("big.bin", tmp_path)
    assert script.requests[0][2]["range"] == "bytes=700000-"
    assert (tmp_path / "big.bin").read_bytes() == CONTENT


def test_a_server_that_ignores_ranges_is_started_over(large: Snapshot, script: Any, tmp_path: Path) -> None:
    (tmp_path / f".big.bin.{SHA256[:12]}.part").write_bytes(CONTENT[:700_000])
    script.acts = [lambda handler: serving(handler, 0, len(CONTENT))]
    assert large.download("big.bin", tmp_path).read_bytes() == CONTENT


def test_damage_is_noticed_and_not_kept(large: Snapshot, script: Any, tmp_path: Path) -> None:
    part = tmp_path / f".big.bin.{SHA256[:12]}.part"
    part.write_bytes(b"\0" * 700_000)
    script.acts = [breaking_after(len(CONTENT))]
    with pytest.raises(DamagedDownloadError):
        large.download("big.bin", tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert large.download("big.bin", tmp_path).read_bytes() == CONTENT


def test_a_download_that_does_not_move_ends(large: Snapshot, script: Any, tmp_path: Path) -> None:
    script.acts = [lambda handler: serving(handler, 0, 0, declared=len(CONTENT))]
    with pytest.raises(Exception, match="broke") as caught:
        large.download("big.bin", tmp_path)
    assert getattr(caught.value, "retryable", False)
    assert len(script.requests) == 2
