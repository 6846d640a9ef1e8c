"""Connections that break, stall, or send to the same upload."""

import asyncio
import os
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from fvs_service.gateway.rest.bodies import blocks
from fvs_service.images.upload_files import Writer
from fvs_service.images.upload_locks import UploadLocks
from starlette.requests import Request
from tus_device import Device, bytes_on_disk, send_raw, wait_until


@pytest.mark.parametrize("size", [1, 1000, 100_000, 700_001])
def test_what_arrived_before_a_connection_broke_is_kept(gateway: Any, size: int) -> None:
    content = os.urandom(1_000_000)
    device = Device(gateway.client, gateway.scene(), content)
    device.create()
    with send_raw(gateway, device, content[:size], length=len(content)):
        pass
    wait_until(lambda: device.offset == size)
    assert device.patch(size).status_code == 204
    assert device.image()["verdict"] == "unreadable", "noise, but all of it"


def test_what_arrived_while_earlier_bytes_were_written_is_kept(
    gateway: Any, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, writing, may_end = Writer.write, threading.Event(), threading.Event()

    def slow(writer: Writer, content: bytes) -> None:
        writing.set()
        assert may_end.wait(30)
        write(writer, content)

    monkeypatch.setattr(Writer, "write", slow)
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        assert writing.wait(30)
        for start in (300, 600):  # the second of them lies in the server when the connection breaks
            connection.sendall(device.content[start : start + 300])
            time.sleep(0.2)
    time.sleep(0.2)
    may_end.set()
    wait_until(lambda: device.offset == 900)


def test_what_arrived_before_a_request_is_ended_is_not_dropped() -> None:
    parts = iter([b"x"])

    async def receive() -> dict[str, Any]:
        for part in parts:
            return {"type": "http.request", "body": part, "more_body": True}
        await asyncio.Event().wait()
        raise AssertionError

    async def run() -> list[bytes]:
        found = []

        async def read() -> None:
            async for block in blocks(Request({"type": "http"}, receive)):
                found.append(block)  # noqa: PERF401 - it is cancelled

        reading = asyncio.ensure_future(read())
        await asyncio.sleep(0.05)
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
        return found

    assert asyncio.run(run()) == [b"x"]


def test_what_arrived_of_a_request_that_stops_is_kept(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(upload_idle_s=0.2)
    device = Device(gateway.client, gateway.scene(), photograph(1))
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        assert connection.recv(64).startswith(b"HTTP/1.1 408 ")
    assert device.offset == 300
    assert device.patch(300).status_code == 204


def test_of_two_requests_the_first_goes_on_while_its_bytes_arrive(gateway: Any, device: Device) -> None:
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        wait_until(lambda: device.offset == 300)
        second = device.patch(300)
        assert (second.status_code, second.json()["code"]) == (423, "locked")
        assert second.headers["retry-after"] == "1"
        connection.sendall(device.content[300:])
        assert connection.recv(64).startswith(b"HTTP/1.1 204 ")
    assert device.image()["verdict"] == "accepted"


def test_a_request_of_which_nothing_arrives_gives_way(
    gateway: Any, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_service.images.upload_locks._STALLED_S", 0.2)
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        wait_until(lambda: device.offset == 300)
        time.sleep(0.3)
        assert device.patch(300).status_code == 204, "the device is back, over another link"
        assert connection.recv(64).startswith(b"HTTP/1.1 423 ")
    assert device.image()["verdict"] == "accepted"


def test_a_deletion_ends_the_request_that_sends(gateway: Any, device: Device) -> None:
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        wait_until(lambda: device.offset == 300)
        assert device.delete().status_code == 204
        assert connection.recv(64).startswith(b"HTTP/1.1 423 ")
    assert bytes_on_disk(gateway) == 0


def test_an_upload_whose_image_is_not_stored_yet_is_not_finished(gateway: Any, device: Device) -> None:
    """As after a gateway that was killed between the last byte and the image."""
    device.create(device.content[:100])
    (part,) = gateway.settings.uploads.rglob("*.part")
    part.write_bytes(device.content)
    assert device.offset == len(device.content)
    assert device.image()["verdict"] == "accepted"
    damaged = Device(gateway.client, device.scene, b"x" * 500)
    damaged.create(b"x" * 100)
    (part,) = gateway.settings.uploads.rglob("*.part")
    part.write_bytes(b"y" * 500)
    assert damaged.head().status_code == 404
    assert bytes_on_disk(gateway) == 0


def test_who_asks_while_an_image_is_stored_waits(
    gateway: Any, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = gateway.app.state.application.images
    store, storing, may_end = images.store, threading.Event(), threading.Event()

    def slow(*arguments: Any) -> Any:
        storing.set()
        assert may_end.wait(30)
        return store(*arguments)

    monkeypatch.setattr(images, "store", slow)
    device.create()
    answers: list[Any] = []
    ask = [
        threading.Thread(target=lambda: answers.append(device.patch(0).status_code)),
        threading.Thread(target=lambda: answers.append(device.offset)),
    ]
    ask[0].start()
    assert storing.wait(30)
    ask[1].start()
    time.sleep(0.3)
    assert not answers
    may_end.set()
    for thread in ask:
        thread.join()
    assert sorted(answers) == [204, len(device.content)]


def test_an_upload_that_is_sent_is_not_deleted_meanwhile(
    serve: Any, photograph: Callable[..., bytes]
) -> None:
    gateway = serve(
        limits={"partial_uploads_per_tenant": 1}, upload_place_s=0.1, partial_upload_s=1.0, sweep_s=0.02
    )
    scene = gateway.scene()
    device, other = (Device(gateway.client, scene, photograph(seed)) for seed in range(2))
    device.create()
    with send_raw(gateway, device, device.content[:300], length=len(device.content)) as connection:
        wait_until(lambda: bytes_on_disk(gateway) == 300)
        time.sleep(1.2)  # longer than it is kept, and than it is spared
        assert other.create().status_code == 429
        assert bytes_on_disk(gateway) == 300
        connection.sendall(device.content[300:])
        assert connection.recv(64).startswith(b"HTTP/1.1 204 ")
    assert device.image()["verdict"] == "accepted"
    assert other.create().status_code == 201


def test_an_upload_needs_a_place(serve: Any, photograph: Callable[..., bytes]) -> None:
    gateway = serve(limits={"open_uploads_per_tenant": 1})
    scene = gateway.scene()
    first, second = (Device(gateway.client, scene, photograph(seed)) for seed in range(2))
    for one in (first, second):
        one.create()
    with send_raw(gateway, first, first.content[:300], length=len(first.content)):
        wait_until(lambda: first.offset == 300)
        refused = second.patch(0)
        assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    wait_until(lambda: second.patch(0).status_code == 204)


def test_locks_are_given_to_one_after_the_other() -> None:
    async def run() -> list[str]:
        locks, order = UploadLocks(), []

        async def use(name: str) -> None:
            async with locks.locked("upl_a"):
                order.append(f"{name} begins")
                await asyncio.sleep(0.01)
                order.append(f"{name} ends")

        await asyncio.gather(use("one"), use("two"))
        async with locks.locked("upl_a"), locks.locked("upl_b"):
            pass
        return order

    assert asyncio.run(run()) == ["one begins", "one ends", "two begins", "two ends"]
