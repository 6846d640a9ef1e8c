"""Uploads in progress when the gateway is killed."""

import contextlib
import hashlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import grpc
import httpx2
import pytest
from fvs.v1 import images_pb2 as pb
from fvs.v1.images_pb2_grpc import ImageServiceStub
from fvs_service.serving.process_tree import descendants
from fvs_service.serving.running import RunningService, running_service
from fvs_service.settings import Settings

_CHUNK = 16_384


@contextlib.contextmanager
def _images(service: RunningService) -> Iterator[ImageServiceStub]:
    with grpc.insecure_channel(service.rpc_url.removeprefix("grpc://")) as channel:
        yield ImageServiceStub(channel)


def _kill(service: RunningService) -> None:
    for pid in (service.pid, *descendants(service.pid)):  # the supervisor first: it would start others
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.system
@pytest.mark.process
def test_an_upload_resumes_after_the_gateway_was_killed(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    root, content = tmp_path / "service", photograph(1, (640, 480))
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    uploads, killed = Settings(root=root).uploads, threading.Event()

    def parts(scene: str, offset: int, *, then_wait: bool) -> Iterator[pb.UploadImageRequest]:
        size = len(content)
        upload = {"scene_id": scene, "digest": digest, "size_bytes": size, "offset_bytes": offset}
        yield pb.UploadImageRequest(upload=upload)
        stop = 3 * _CHUNK if then_wait else size
        for start in range(offset, stop, _CHUNK):
            yield pb.UploadImageRequest(chunk=content[start : min(start + _CHUNK, stop)])
        if then_wait:
            killed.wait(60)

    with running_service(root, tmp_path / "first.log") as service:
        scene = httpx2.post(f"{service.url}/v1/scenes", json={"name": "a"}).json()["id"]
        with _images(service) as stub:
            call = stub.UploadImage.future(parts(scene, 0, then_wait=True))
            deadline = time.monotonic() + 30
            while sum(file.stat().st_size for file in uploads.rglob("*.part")) < 3 * _CHUNK:
                assert not call.done()
                assert time.monotonic() < deadline
                time.sleep(0.02)
            _kill(service)
            killed.set()
            with pytest.raises(grpc.RpcError):
                call.result(30)

    with running_service(root, tmp_path / "second.log") as service, _images(service) as stub:
        found = stub.GetUpload(pb.GetUploadRequest(scene_id=scene, digest=digest), timeout=30)
        assert found.offset_bytes == 3 * _CHUNK
        sent = stub.UploadImage(parts(scene, found.offset_bytes, then_wait=False), timeout=60)
        assert sent.created
        assert sent.image.verdict == pb.VERDICT_ACCEPTED
