"""Uploads that go on: by tuspy, another run of it, and after the gateway has ended."""

import contextlib
import io
import os
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import pytest
from fvs_service.serving.process_tree import descendants
from fvs_service.serving.running import RunningService, running_service
from tus_device import Device, sha256_of
from tusclient.client import TusClient


@pytest.mark.parametrize("chunk_bytes", [700, 2**40])
def test_tuspy_sends_an_image(gateway: Any, device: Device, chunk_bytes: int) -> None:
    client = TusClient(f"{gateway.client.base_url}/v1/uploads")
    given = {"scene": device.scene, "sha256": sha256_of(device.content), "filename": "a.jpg"}

    def uploader(**options: Any) -> Any:
        file = io.BytesIO(device.content)
        return client.uploader(
            file_stream=file, chunk_size=chunk_bytes, metadata=given, upload_checksum=True, **options
        )

    first = uploader()
    first.upload(stop_at=1400)
    assert first.offset == 1400
    uploader(url=first.url).upload()
    assert device.image()["verdict"] == "accepted"
    uploader(retries=1, retry_delay=0).upload()  # the scene has it


def test_tuspy_goes_on_with_what_another_run_created(gateway: Any, device: Device) -> None:
    device.create(device.content[:1000])
    client = TusClient(f"{gateway.client.base_url}/v1/uploads")
    given = {"scene": device.scene, "sha256": sha256_of(device.content)}
    file = io.BytesIO(device.content)
    client.uploader(file_stream=file, metadata=given, retries=1, retry_delay=0).upload()
    assert device.image()["verdict"] == "accepted"


def _kill(service: RunningService) -> None:
    for pid in (service.pid, *descendants(service.pid)):  # the supervisor first: it would start others
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.system
@pytest.mark.process
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_an_upload_goes_on_after_the_gateway_ended(
    tmp_path: Path, photograph: Callable[..., bytes], how: signal.Signals
) -> None:
    """What was not written for half a second is lost when it is killed, and nothing when it is stopped."""
    root, content = tmp_path / "service", photograph(1, (640, 480))
    with (
        running_service(root, tmp_path / "first.log", {"FVS_DRAIN_S": "0.2"}) as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        scene = client.post("/v1/scenes", json={"name": "a"}).json()["id"]
        device = Device(client, scene, content)
        device.create(content[:20_000])
        url = urlsplit(service.url)
        with socket.create_connection((url.hostname, url.port), 30) as connection:
            connection.sendall(
                f"PATCH {device.url} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\n"
                "Upload-Offset: 20000\r\nContent-Type: application/offset+octet-stream\r\n"
                f"Content-Length: {len(content) - 20_000}\r\n\r\n".encode()
            )
            sent = 20_000
            deadline = time.monotonic() + 30
            while device.offset < 30_000:  # what is written while the request goes on
                assert time.monotonic() < deadline
                connection.sendall(content[sent : sent + 1000])
                sent += 1000
                time.sleep(0.05)
            reached = device.offset
            if how is signal.SIGKILL:
                _kill(service)
            else:
                os.kill(service.pid, how)
                assert connection.recv(64)
                reached = sent
    with (
        running_service(root, tmp_path / "second.log") as service,
        httpx2.Client(base_url=service.url, timeout=60) as client,
    ):
        again = Device(client, scene, content)
        again.url = device.url
        assert reached <= again.offset <= sent
        assert again.patch(again.offset).status_code == 204
        assert again.image()["verdict"] == "accepted"
