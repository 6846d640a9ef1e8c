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
from fvs_service.images.partial_uploads import NewUpload, PartialUploads
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


@pytest.mark.process
def test_an_upload_resumes_after_the_gateway_was_killed(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    root, content = tmp_path / "service", photograph(1, (640, 480))
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    staging, killed = Settings(root=root).staging, threading.Event()

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
            while sum(file.stat().st_size for file in staging.iterdir()) < 3 * _CHUNK:
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
        assert not list(staging.iterdir())
        sent = stub.UploadImage(parts(scene, found.offset_bytes, then_wait=False), timeout=60)
        assert sent.created
        assert sent.image.verdict == pb.VERDICT_ACCEPTED


def _cut(uploads: PartialUploads, staging: Path, tenant: str, digit: str, size: int, age_s: float) -> None:
    """A file that a gateway left which was killed."""
    staging.mkdir(exist_ok=True)
    new = NewUpload(scene_id="scn", digest=f"sha256:{digit * 64}", size_bytes=99)
    file = staging / f"{uploads.name(tenant, new)}.1.upload"
    file.write_bytes(b"x" * size)
    os.utime(file, (time.time() - age_s,) * 2)


def test_of_what_was_cut_the_largest_of_each_tenant_is_kept(tmp_path: Path) -> None:
    uploads, staging = PartialUploads(tmp_path / "partial", keep_s=3600.0, per_tenant=1), tmp_path / "staging"
    _cut(uploads, staging, "a", "1", 20, age_s=20.0)
    _cut(uploads, staging, "a", "2", 10, age_s=10.0)
    _cut(uploads, staging, "b", "1", 50, age_s=7200.0)
    _cut(uploads, staging, "c", "3", 5, age_s=30.0)
    (staging / ".2.upload").write_bytes(b"over REST")
    uploads.recover(staging)
    assert [file.name for file in staging.iterdir()] == [".2.upload"]
    assert uploads.find("a", "scn", f"sha256:{'1' * 64}").offset_bytes == 20
    assert uploads.find("c", "scn", f"sha256:{'3' * 64}").offset_bytes == 5
    assert len(list(uploads.folder.iterdir())) == 2


def test_a_gateway_starts_when_what_was_cut_cannot_be_kept(tmp_path: Path) -> None:
    (tmp_path / "partial").write_bytes(b"no folder")
    uploads, staging = PartialUploads(tmp_path / "partial", keep_s=3600.0, per_tenant=1), tmp_path / "staging"
    _cut(uploads, staging, "a", "1", 20, age_s=0.0)
    uploads.recover(staging)
    assert len(list(staging.iterdir())) == 1
