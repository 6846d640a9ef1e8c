"""Turns to inspect uploads: whoever sends many does not hold up the others."""

import asyncio
import hashlib
import threading
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from fvs.v1.images_pb2 import UploadImageRequest, UploadImageResponse
from fvs_service.images.fair_turns import FairTurns
from fvs_service.principal import ALL_SCOPES, LOCAL_USER, Principal
from grpc_uploads import upload_over_grpc


def _principal(name: str) -> Principal:
    tenant, _, key = name.partition("/")
    return Principal(tenant, ALL_SCOPES, key_id=key)


async def _order(at_once: int, who: Sequence[str]) -> list[str]:
    """The order in which those who ask in this order, all before the first turn ends, get their turns."""
    turns, served = FairTurns(at_once), list[str]()

    async def ask(name: str) -> None:
        async with turns.turn(_principal(name)):
            served.append(name)
            await asyncio.sleep(0)

    await asyncio.gather(*map(ask, who))
    return served


def test_turns_go_around_between_tenants() -> None:
    served = asyncio.run(_order(1, ["many"] * 5 + ["few"] * 2 + ["one"]))
    assert served == ["many", "few", "one", "many", "few", "many", "many", "many"]


def test_turns_go_around_between_the_keys_of_a_tenant() -> None:
    served = asyncio.run(_order(1, ["a/1"] * 4 + ["a/2", "b/1"]))
    assert served == ["a/1", "b/1", "a/2", "a/1", "a/1", "a/1"]


def test_who_holds_turns_waits_for_who_has_none() -> None:
    async def run() -> list[str]:
        turns, served, long = FairTurns(2), list[str](), asyncio.Event()

        async def ask(name: str) -> None:
            async with turns.turn(_principal(name)):
                served.append(name)
                if name == "long":
                    await long.wait()

        tasks = [asyncio.create_task(ask(name)) for name in ["long", "long", "long", "long", "other"]]
        await asyncio.sleep(0.01)
        assert served == ["long", "long"]
        long.set()
        await asyncio.gather(*tasks)
        return served

    assert asyncio.run(run())[2] == "other"


@pytest.mark.parametrize("when", ["waiting", "chosen", "running"])
def test_a_request_that_is_cut_gives_its_turn_back(when: str) -> None:
    async def run() -> None:
        turns, done = FairTurns(1), asyncio.Event()

        async def hold() -> None:
            async with turns.turn(_principal("a")):
                await done.wait()

        first, second = asyncio.create_task(hold()), asyncio.create_task(hold())
        await asyncio.sleep(0.01)
        if when == "waiting":
            second.cancel()
        elif when == "running":
            first.cancel()
        else:
            first.cancel()
            await asyncio.sleep(0)  # the turn is the second's now, which does not know yet
            second.cancel()
        await asyncio.sleep(0.01)
        done.set()
        await asyncio.gather(first, second, return_exceptions=True)
        async with asyncio.timeout(5), turns.turn(_principal("b")):
            pass

    asyncio.run(run())


def test_a_turn_can_end_in_the_moment_in_which_the_next_request_is_cut() -> None:
    async def run() -> list[BaseException | None]:
        turns, done = FairTurns(1), asyncio.Event()

        async def hold() -> None:
            async with turns.turn(_principal("a")):
                await done.wait()

        first, second = asyncio.create_task(hold()), asyncio.create_task(hold())
        await asyncio.sleep(0)
        await asyncio.sleep(0)  # the first holds the turn, the second waits for it
        done.set()
        second.cancel()  # takes effect only after the first has ended
        ended = await asyncio.gather(first, second, return_exceptions=True)
        async with asyncio.timeout(5), turns.turn(_principal("b")):
            pass
        return ended

    first, second = asyncio.run(run())
    assert first is None
    assert isinstance(second, asyncio.CancelledError)


class Upload:
    """An image that is sent to a scene over gRPC."""

    def __init__(self, gateway: Any, content: bytes) -> None:
        self._gateway, self._content = gateway, content
        self._scene = gateway.scene()
        self.digest = f"sha256:{hashlib.sha256(content).hexdigest()}"

    def send(self, offset: int = 0) -> "asyncio.Task[UploadImageResponse]":
        about = {
            "scene_id": self._scene,
            "digest": self.digest,
            "size_bytes": len(self._content),
            "offset_bytes": offset,
        }
        left = self._content[offset:]
        sent = [UploadImageRequest(upload=about), *([UploadImageRequest(chunk=left)] if left else [])]
        messages = iter([one.SerializeToString() for one in sent])

        async def receive() -> bytes | None:
            return next(messages, None)

        return asyncio.create_task(upload_over_grpc(self._gateway, receive))

    def arrived_bytes(self) -> int:
        kept = self._gateway.application.uploads
        return int(kept.find_part(LOCAL_USER.tenant_id, self._scene, self.digest).offset_bytes)

    def image(self) -> Any:
        return self._gateway.application.images.get(LOCAL_USER, self._scene, self.digest)


@pytest.fixture
def upload(open_gateway: Callable[..., Any], photograph: Callable[[int], bytes]) -> Upload:
    return Upload(open_gateway(inspectors=1), photograph(1))


@pytest.fixture
def images(upload: Upload) -> Any:
    return upload._gateway.application.images


@pytest.fixture
def turns(upload: Upload) -> FairTurns:
    """Two turns."""
    turns: FairTurns = upload._gateway.application.inspection_turns
    return turns


def test_an_upload_that_is_cut_while_it_waits_for_its_turn_need_not_be_sent_again(
    upload: Upload, turns: FairTurns
) -> None:
    async def run() -> UploadImageResponse:
        async with turns.turn(LOCAL_USER), turns.turn(LOCAL_USER):
            cut = upload.send()
            while not turns._waiting:
                await asyncio.sleep(0.01)
            cut.cancel()
            await asyncio.gather(cut, return_exceptions=True)
        return await upload.send(offset=upload.arrived_bytes())

    assert asyncio.run(run()).created


def test_an_upload_that_is_cut_while_it_is_inspected_is_stored_and_holds_its_turn_until_then(
    upload: Upload, turns: FairTurns, images: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, may_end, store = threading.Event(), threading.Event(), images.store

    def slow(*arguments: Any) -> Any:
        began.set()
        assert may_end.wait(30)
        return store(*arguments)

    monkeypatch.setattr(images, "store", slow)

    async def run() -> None:
        cut = upload.send()
        while not began.is_set():
            await asyncio.sleep(0.01)
        cut.cancel()
        async with turns.turn(LOCAL_USER):
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.1), turns.turn(LOCAL_USER):
                    pass
        may_end.set()
        with pytest.raises(asyncio.CancelledError):
            await cut

    asyncio.run(run())
    assert upload.image().digest == upload.digest
