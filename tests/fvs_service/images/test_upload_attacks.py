"""Resumable uploads of clients that lie, race, stall, or ask for what is not theirs."""

import base64
import contextlib
import hashlib
import io
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import pytest
from fvs_service.principal import Scope
from fvs_service.serving.process_tree import descendants
from fvs_service.serving.running import running_service
from tusclient.client import TusClient
from tusclient.exceptions import TusCommunicationError

_VERSION = {"Tus-Resumable": "1.0.0"}
_TYPE = {"Content-Type": "application/offset+octet-stream"}


def _encoded(value: str) -> str:
    return base64.b64encode(value.encode()).decode()


def _creation(scene: str, content: bytes, **other: str) -> dict[str, str]:
    """Headers that create the upload of an image."""
    fields = {"scene": scene, "sha256": hashlib.sha256(content).hexdigest(), **other}
    return {
        **_VERSION,
        "Upload-Length": str(len(content)),
        "Upload-Metadata": ",".join(f"{name} {_encoded(value)}" for name, value in fields.items()),
    }


def _create(gateway: Any, scene: str, content: bytes, **other: str) -> str:
    made = gateway.client.post("/v1/uploads", headers=_creation(scene, content, **other))
    assert made.status_code == 201, made.text
    return str(made.headers["location"])


def _patch(
    gateway: Any, url: str, offset: int, content: bytes, headers: Mapping[str, str] | None = None
) -> httpx2.Response:
    sent = {**_VERSION, **_TYPE, "Upload-Offset": str(offset), **(headers or {})}
    answer: httpx2.Response = gateway.client.patch(url, headers=sent, content=content)
    return answer


def _files(gateway: Any) -> list[str]:
    """Everything on disk that uploads have left."""
    return sorted(file.name for file in gateway.settings.uploads.rglob("*") if file.is_file())


def _connect(gateway: Any) -> socket.socket:
    url = urlsplit(str(gateway.client.base_url))
    return socket.create_connection((url.hostname, url.port), 30)


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("method", ["POST", "PATCH"])
def test_a_stranger_leaves_no_byte(serve: Any, photograph: Callable[..., bytes], method: str) -> None:
    gateway = serve(require_keys=True)
    content = photograph(1)
    scene = gateway.scene(gateway.key("owner"))
    path = "/v1/uploads" if method == "POST" else f"/v1/uploads/upl_{'0' * 32}"
    headers = {**_creation(scene, content), **_TYPE, "Upload-Offset": "0"}
    answer = gateway.client.request(method, path, headers=headers, content=content)
    assert answer.status_code == 401
    assert answer.headers["tus-resumable"] == "1.0.0"
    assert _files(gateway) == []


def test_of_many_that_send_the_same_bytes_at_once_one_is_heard(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve()
    content = photograph(1, (640, 480))
    scene = gateway.scene()
    url = _create(gateway, scene, content)
    together, answers = threading.Barrier(8), []

    def send() -> None:
        together.wait(30)
        answers.append(_patch(gateway, url, 0, content).status_code)

    threads = [threading.Thread(target=send) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers.count(204) == 1, answers
    assert set(answers) <= {204, 409, 423}
    image = f"/v1/scenes/{scene}/images/sha256:{hashlib.sha256(content).hexdigest()}"
    assert gateway.client.get(f"{image}/content").content == content


def test_a_length_that_is_too_small_stores_nothing(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve()
    content = photograph(1)
    scene = gateway.scene()
    headers = {**_creation(scene, content), "Upload-Length": "100"}
    url = gateway.client.post("/v1/uploads", headers=headers).headers["location"]
    assert _patch(gateway, url, 0, content).status_code == 413
    cut = _patch(gateway, url, 0, content[:100])
    assert (cut.status_code, cut.json()["code"]) == (422, "digest-mismatch")
    assert _files(gateway) == []
    assert gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"] == []


def test_a_length_that_is_too_large_is_never_complete(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve()
    content = photograph(1)
    scene = gateway.scene()
    headers = {**_creation(scene, content), "Upload-Length": str(len(content) + 1)}
    url = gateway.client.post("/v1/uploads", headers=headers).headers["location"]
    assert _patch(gateway, url, 0, content).headers["upload-offset"] == str(len(content))
    assert gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"] == []
    assert gateway.put(scene, content).status_code == 201, "the right length is not in its way"


@pytest.mark.parametrize(
    "filename",
    [
        "../../etc/passwd",
        "..",
        "/",
        "C:\\DCIM\\..",
        "a\x00b.jpg",
        "a\r\nSet-Cookie: b.jpg",
        "\u202egpj.exe",
        "x" * 5000,
    ],
)
def test_no_filename_fails_an_upload_or_leaves_the_folder(
    serve: Any, photograph: Callable[..., bytes], filename: str
) -> None:
    gateway = serve()
    content = photograph(1)
    scene = gateway.scene()
    url = _create(gateway, scene, content, filename=filename)
    last = _patch(gateway, url, 0, content)
    assert last.status_code == 204, last.text
    assert "set-cookie" not in last.headers
    image = gateway.client.get(last.headers["content-location"]).json()
    assert image["verdict"] == "accepted"
    name = image["name"] or ""
    assert name not in {".", ".."}
    assert not set(name) & set("/\\\x00\r\n"), name


@pytest.mark.parametrize("name", ["a\x00b", "a\nb", "../a", "a\\b"])
def test_a_name_with_control_characters_or_folders_is_refused(
    serve: Any, photograph: Callable[..., bytes], name: str
) -> None:
    gateway = serve()
    answer = gateway.client.post("/v1/uploads", headers=_creation(gateway.scene(), photograph(1), name=name))
    assert answer.status_code == 422, answer.text
    assert _files(gateway) == []


@pytest.mark.parametrize("scene", ["../../../etc", "scn_\x00", "scn_" + "0" * 4000, "%2e%2e"])
def test_a_scene_that_is_a_path_is_not_found(
    serve: Any, photograph: Callable[..., bytes], scene: str
) -> None:
    gateway = serve()
    answer = gateway.client.post("/v1/uploads", headers=_creation(scene, photograph(1)))
    assert answer.status_code in {400, 404, 422}, answer.text
    assert _files(gateway) == []


@pytest.mark.parametrize("upload", ["..", "%2e%2e%2f%2e%2e", "upl_" + "0" * 32 + "%0a", "upl_" + "0" * 5000])
def test_an_address_that_is_no_upload_is_not_found(serve: Any, upload: str) -> None:
    gateway = serve()
    with _connect(gateway) as connection:
        connection.sendall(
            f"HEAD /v1/uploads/{upload} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\n\r\n".encode()
        )
        status = int(connection.recv(64).split()[1])
    assert status in {404, 405, 422}


def test_a_scene_that_is_deleted_while_an_image_arrives_takes_it_along(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve()
    content = photograph(1, (320, 240))
    scene = gateway.scene()
    url = _create(gateway, scene, content)
    with _connect(gateway) as connection:
        connection.sendall(
            f"PATCH {url} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
            "Content-Type: application/offset+octet-stream\r\n"
            f"Content-Length: {len(content)}\r\n\r\n".encode()
            + content[:500]
        )
        _until(lambda: gateway.client.head(url, headers=_VERSION).headers["upload-offset"] == "500")
        assert gateway.client.delete(f"/v1/scenes/{scene}").is_success
        connection.sendall(content[500:])
        assert connection.recv(64).startswith(b"HTTP/1.1 404 ")
    for method in ("HEAD", "DELETE"):
        assert gateway.client.request(method, url, headers=_VERSION).status_code == 404
    assert _patch(gateway, url, 500, content[500:]).status_code == 404
    _until(lambda: not [name for name in _files(gateway) if name.endswith(".part")])


def test_bytes_of_an_upload_whose_scene_is_gone_hold_no_room(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(limits={"partial_uploads_per_tenant": 1}, upload_place_s=100)
    content = photograph(1)
    scene = gateway.scene()
    url = _create(gateway, scene, content)
    assert _patch(gateway, url, 0, content[:100]).status_code == 204
    assert gateway.client.delete(f"/v1/scenes/{scene}").is_success
    assert gateway.client.head(url, headers=_VERSION).status_code == 404
    assert _files(gateway) == []
    _create(gateway, gateway.scene(), content)


def test_a_key_that_may_only_read_adds_no_byte_to_an_upload(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(require_keys=True)
    owner = gateway.key("owner")
    scene = gateway.scene(owner)
    reader = gateway.key("owner", scopes=frozenset({Scope.READ}))
    content = photograph(1)
    url = gateway.client.post("/v1/uploads", headers={**_creation(scene, content), **owner}).headers[
        "location"
    ]
    assert _patch(gateway, url, 0, content[:10], owner).status_code == 204
    assert _patch(gateway, url, 10, content[10:], reader).status_code == 403
    assert gateway.client.head(url, headers={**_VERSION, **owner}).headers["upload-offset"] == "10"


@pytest.mark.system
def test_very_many_uploads_leave_no_more_files_than_are_allowed(serve: Any) -> None:
    gateway = serve(limits={"partial_uploads_per_tenant": 5}, upload_place_s=100)
    scene = gateway.scene()
    answers = [
        gateway.client.post("/v1/uploads", headers=_creation(scene, b"%d" % number)).status_code
        for number in range(100)
    ]
    assert answers == [201] * 5 + [429] * 95
    assert len(_files(gateway)) == 10


def test_a_clock_that_was_set_back_holds_up_nobody_for_longer_than_usual(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(limits={"partial_uploads_per_tenant": 1}, upload_place_s=100, partial_upload_s=1000)
    scene = gateway.scene()
    _create(gateway, scene, photograph(1))
    for file in gateway.settings.uploads.rglob("*"):
        os.utime(file, (time.time() + 86_400,) * 2)
    refused = gateway.client.post("/v1/uploads", headers=_creation(scene, photograph(2)))
    assert refused.status_code == 201, refused.text
    for file in gateway.settings.uploads.rglob("*"):
        os.utime(file, (time.time() + 60,) * 2)
    refused = gateway.client.post("/v1/uploads", headers=_creation(scene, photograph(3)))
    assert (refused.status_code, refused.headers["retry-after"]) == (429, "100")


@pytest.mark.system
@pytest.mark.process
def test_tuspy_goes_on_after_the_gateway_was_killed(tmp_path: Path, photograph: Callable[..., bytes]) -> None:
    root, content = tmp_path / "service", photograph(1, (640, 480))
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"

    def uploader(service_url: str, **options: Any) -> Any:
        client = TusClient(f"{service_url}/v1/uploads")
        return client.uploader(file_stream=io.BytesIO(content), chunk_size=4_000, **options)

    with (
        running_service(root, tmp_path / "first.log") as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        scene = client.post("/v1/scenes", json={"name": "a"}).json()["id"]
        first = uploader(service.url, metadata={"scene": scene, "sha256": digest.removeprefix("sha256:")})
        first.upload(stop_at=12_000)
        for pid in (service.pid, *descendants(service.pid)):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        with pytest.raises(TusCommunicationError):
            first.upload()
    with (
        running_service(root, tmp_path / "second.log") as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        again = uploader(service.url, url=f"{service.url}{urlsplit(first.url).path}")
        assert again.offset == 12_000
        again.upload()
        other = client.post("/v1/scenes", json={"name": "b"}).json()["id"]
        assert client.put(f"/v1/scenes/{other}/images/{digest}", content=content).is_success
        by_tus, by_put = (client.get(f"/v1/scenes/{one}/images/{digest}").json() for one in (scene, other))
        assert (by_tus["digest"], by_tus["verdict"]) == (by_put["digest"], by_put["verdict"])
        assert client.get(f"/v1/scenes/{scene}/images/{digest}/content").content == content
