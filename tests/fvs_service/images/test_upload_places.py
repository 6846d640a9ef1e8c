"""Places for uploads that are all held: who gives way, who waits, and for how long."""

import asyncio
import contextlib
import hashlib
import threading
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import pytest
from fvs.v1.images_pb2 import UploadImageRequest
from fvs_service.errors import LimitExceededError, NotFoundError, OutOfSpaceError, SlowRequestError
from fvs_service.gateway.rest.multipart import receive_files
from fvs_service.images.upload_files import Writer
from fvs_service.images.upload_places import UploadPlace, UploadPlaces
from fvs_service.images.uploads import Upload, Uploads
from fvs_service.principal import ALL_SCOPES, LOCAL_USER, Principal
from fvs_service.storage import blobs
from grpc_uploads import upload_over_grpc
from starlette.requests import Request

from fvs_schema.images import ImageMetadata

_LONG_S = 1000.0


def _uploads(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, free: int = 10_000, max_bytes: int = 1_000
) -> Uploads:
    monkeypatch.setattr(blobs, "free_bytes", lambda _: free)
    return Uploads(
        folder,
        keep_s=60,
        per_tenant=9,
        spared_s=60,
        reserve_bytes=0,
        max_bytes=max_bytes,
        max_video_bytes=max_bytes,
    )


def _upload(size_bytes: int, digit: str = "1") -> Upload:
    return Upload(
        tenant_id="tenant",
        scene_id="scn_1",
        digest=f"sha256:{digit * 64}",
        size_bytes=size_bytes,
        metadata=ImageMetadata(),
    )


@dataclass
class _Arrival:
    received_bytes: int = 0


def _key(key_id: str, tenant_id: str = "tenant") -> Principal:
    return Principal(tenant_id, ALL_SCOPES, key_id=key_id)


@contextlib.asynccontextmanager
async def _uploading(
    places: UploadPlaces, key: Principal, received_bytes: int = 0, expected_bytes: int | None = None
) -> AsyncIterator["asyncio.Task[None]"]:
    """An upload that has come so far and goes on until its place is taken."""
    began = asyncio.Event()

    async def send() -> None:
        with places.place(key, _Arrival(received_bytes), expected_bytes) as place:
            async with place.receiving():
                began.set()
                await asyncio.Event().wait()

    task = asyncio.create_task(send())
    await began.wait()
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def _ask(places: UploadPlaces, key: Principal) -> None:
    with places.place(key, _Arrival(), None) as place:
        assert isinstance(place, UploadPlace)


def test_the_slowest_upload_of_a_key_with_more_gives_way_after_the_grace_period() -> None:
    async def run() -> None:
        places, greedy = UploadPlaces(3, grace_s=0.0, hold_s=_LONG_S), _key("greedy")
        async with (
            _uploading(places, greedy, 900_000) as first,
            _uploading(places, greedy, 1) as slow,
            _uploading(places, greedy, 900_000) as last,
        ):
            await _ask(places, _key("other"))
            with pytest.raises(SlowRequestError, match="bytes per second"):
                await slow
            assert not first.done()
            assert not last.done()

    asyncio.run(run())


def test_a_key_takes_no_place_when_that_would_not_be_fairer() -> None:
    async def run() -> None:
        places = UploadPlaces(3, grace_s=0.0, hold_s=_LONG_S)
        async with (
            _uploading(places, _key("two")),
            _uploading(places, _key("two")),
            _uploading(places, _key("one")),
        ):
            await _ask(places, _key("one"))

    with pytest.raises(LimitExceededError):
        asyncio.run(run())


def test_a_key_does_not_take_its_own_places_until_they_were_held_long() -> None:
    async def run(hold_s: float) -> None:
        places = UploadPlaces(1, grace_s=0.0, hold_s=hold_s)
        async with _uploading(places, _key("a"), 10) as held:
            await _ask(places, _key("a"))
            with pytest.raises(SlowRequestError):
                await held

    with pytest.raises(LimitExceededError):
        asyncio.run(run(_LONG_S))
    asyncio.run(run(0.0))


def test_retry_after_is_when_an_upload_ends_or_gives_way() -> None:
    async def refused(key: Principal, grace_s: float, *uploads: tuple[int, int | None]) -> int:
        places = UploadPlaces(len(uploads), grace_s=grace_s, hold_s=_LONG_S)
        async with contextlib.AsyncExitStack() as stack:
            for received, expected in uploads:
                await stack.enter_async_context(_uploading(places, _key("a"), received, expected))
            with pytest.raises(LimitExceededError) as error:
                await _ask(places, key)
        assert error.value.retry_after_s is not None
        return error.value.retry_after_s

    never, almost = (1, None), (999_999, 1_000_000)
    assert asyncio.run(refused(_key("a"), 30.0, never, never)) == _LONG_S
    assert asyncio.run(refused(_key("a"), 30.0, never, almost)) == 1
    assert asyncio.run(refused(_key("b"), 30.0, never, never)) == 30


def test_a_stored_upload_and_those_of_other_tenants_keep_their_places() -> None:
    async def run() -> None:
        places = UploadPlaces(1, grace_s=0.0, hold_s=0.0)
        async with _uploading(places, _key("a", "another tenant")) as foreign:
            with places.place(_key("a"), _Arrival(5), 5) as place:
                async with place.receiving():
                    pass
                with pytest.raises(LimitExceededError) as error:
                    await _ask(places, _key("b"))
                assert error.value.retry_after_s == 1
            await _ask(places, _key("b"))
            assert not foreign.done()

    asyncio.run(run())


def test_what_arrived_over_grpc_of_an_upload_that_gives_way_is_kept(open_gateway: Any) -> None:
    gateway = open_gateway(upload_place_s=0.001, limits={"open_uploads_per_tenant": 1})
    app, scene, digest = gateway.application, gateway.scene(), f"sha256:{'1' * 64}"
    sent = iter(
        (
            UploadImageRequest(upload={"scene_id": scene, "digest": digest, "size_bytes": 900}),
            UploadImageRequest(chunk=b"x" * 500),
        )
    )

    async def run() -> None:
        all_sent = asyncio.Event()

        async def receive() -> bytes:
            for message in sent:
                return message.SerializeToString()
            all_sent.set()
            await asyncio.Event().wait()
            raise AssertionError

        upload = asyncio.create_task(upload_over_grpc(gateway, receive))
        await all_sent.wait()
        await asyncio.sleep(0.01)
        with app.upload_places.place(LOCAL_USER, _Arrival(), None), pytest.raises(SlowRequestError):
            await upload

    asyncio.run(run())
    assert app.uploads.find_part(LOCAL_USER.tenant_id, scene, digest).offset_bytes == 500


def test_an_image_that_the_scene_has_needs_a_place_too(open_gateway: Any, photograph: Any) -> None:
    gateway = open_gateway(limits={"open_uploads_per_tenant": 1})
    app, scene, content = gateway.application, gateway.scene(), photograph(1)
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    url = f"/v1/scenes/{scene}/images/{digest}"
    assert gateway.client.put(url, content=content).status_code == 201

    async def over_grpc() -> None:
        first = UploadImageRequest(
            upload={"scene_id": scene, "digest": digest, "size_bytes": len(content)}
        ).SerializeToString()

        async def receive() -> bytes:
            return first

        await upload_over_grpc(gateway, receive)

    with app.upload_places.place(LOCAL_USER, _Arrival(), None):
        assert gateway.client.put(url, content=content).status_code == 429
        with pytest.raises(LimitExceededError):
            asyncio.run(over_grpc())
    assert gateway.client.put(url, content=content).status_code == 200
    asyncio.run(over_grpc())


def test_an_upload_over_grpc_that_is_cut_while_its_file_is_opened_leaves_none(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    app, scene, digest = gateway.application, gateway.scene(), f"sha256:{'1' * 64}"
    began, may_end, open_writer = threading.Event(), threading.Event(), app.uploads.writer

    def slow(*arguments: Any, **options: Any) -> Any:
        began.set()
        assert may_end.wait(30)
        return open_writer(*arguments, **options)

    async def receive() -> bytes:
        upload = {"scene_id": scene, "digest": digest, "size_bytes": 900}
        return UploadImageRequest(upload=upload).SerializeToString()

    async def run() -> None:
        upload = asyncio.create_task(upload_over_grpc(gateway, receive))
        while not began.is_set():
            await asyncio.sleep(0.01)
        upload.cancel()
        await asyncio.sleep(0.01)
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await upload

    monkeypatch.setattr(app.uploads, "writer", slow)
    asyncio.run(run())
    assert not list(gateway.settings.uploads.rglob("*.part"))


def test_a_form_that_gives_way_while_its_file_is_opened_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploads = _uploads(tmp_path, monkeypatch)
    began, may_end, receive_file = threading.Event(), threading.Event(), uploads.receive
    head = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.jpg"\r\n\r\n'

    def slow(*arguments: Any) -> Any:
        began.set()
        assert may_end.wait(30)
        return receive_file(*arguments)

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": head, "more_body": False}

    async def run() -> None:
        headers = [(b"content-type", b"multipart/form-data; boundary=b")]
        form = Request({"type": "http", "method": "POST", "headers": headers}, receive)
        files = receive_files(form, uploads, 10, anyio.CapacityLimiter(1))
        reading = asyncio.ensure_future(anext(files, None))
        while not began.is_set():
            await asyncio.sleep(0.01)
        reading.cancel()
        await asyncio.sleep(0.01)
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await reading

    monkeypatch.setattr(uploads, "receive", slow)
    asyncio.run(run())
    assert not list(tmp_path.rglob("*.part"))


def test_open_uploads_have_the_room_that_they_may_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploads = _uploads(tmp_path, monkeypatch, free=600, max_bytes=500)
    with uploads.writer(_upload(300), 0, begin=True) as first:
        first.write(b"x" * 100)
        monkeypatch.setattr(blobs, "free_bytes", lambda _: 500)
        with pytest.raises(OutOfSpaceError), uploads.writer(_upload(301), 0, begin=True):
            pass
        with uploads.writer(_upload(300, digit="2"), 0, begin=True) as second:
            assert second.awaited_bytes == 300
            with pytest.raises(OutOfSpaceError):
                uploads.require_room(_upload(1))
        with pytest.raises(OutOfSpaceError):
            uploads.receive()
    with uploads.receive() as receiver:
        receiver.write(b"x" * 100)
        with pytest.raises(OutOfSpaceError, match=r"0 MB must stay free. Other uploads need 0 MB of it"):
            uploads.receive()
        receiver.finish()
        with uploads.receive():
            pass
    assert [part.stat().st_size for part in tmp_path.rglob("*.part")] == [100], "only what arrived is kept"


def test_a_request_that_cannot_begin_gives_its_room_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploads = _uploads(tmp_path, monkeypatch, free=500, max_bytes=500)
    with pytest.raises(NotFoundError), uploads.writer(_upload(500), 0):
        pass
    with uploads.receive():
        pass


def test_what_has_arrived_stays_when_the_disk_is_full(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    app, scene, digest = gateway.application, gateway.scene(), f"sha256:{'1' * 64}"
    sent = iter(
        (
            UploadImageRequest(upload={"scene_id": scene, "digest": digest, "size_bytes": 900}),
            UploadImageRequest(chunk=b"x" * 500),
            UploadImageRequest(chunk=b"x" * 400),
        )
    )
    write = Writer.write

    def full(writer: Writer, chunk: bytes) -> None:
        if writer.offset:
            raise OutOfSpaceError("The disk is full.")
        write(writer, chunk)

    async def receive() -> bytes:
        return next(sent).SerializeToString()

    monkeypatch.setattr(Writer, "write", full)
    with pytest.raises(OutOfSpaceError):
        asyncio.run(upload_over_grpc(gateway, receive))
    assert app.uploads.find_part(LOCAL_USER.tenant_id, scene, digest).offset_bytes == 500
