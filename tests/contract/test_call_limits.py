"""Limits that only gRPC has: on calls, messages, chunks and keys on hold."""

import gc
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from contract_calls import refused, send, upload_parts, wait_until, with_key
from contract_outcome import outcome_of_error
from fvs.v1 import images_pb2 as images
from fvs.v1 import scenes_pb2 as scenes
from fvs.v1 import views_pb2 as views
from fvs_service.gateway.rpc import calls
from fvs_service.serving import rpc_server as server


def silent(until: threading.Event) -> Iterator[bytes]:
    """A request stream of which no message arrives."""
    until.wait(60)
    yield from ()


def test_a_tenant_cannot_take_the_calls_of_others(
    open_rpc: Callable[..., tuple[Any, int]], gateway: Any, tenant: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "_CALLS_PER_TENANT", 3)
    _, port = open_rpc()
    other = gateway.application.storage.keys.create("other", tenant_id="somebody")
    never = threading.Event()

    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        raw = channel.stream_stream("/fvs.v1.ImageService/UploadImage")
        held = [raw(silent(never), metadata=with_key(tenant)) for _ in range(4)]
        deadline = time.monotonic() + 20
        while not any(call.done() for call in held):  # one too many
            assert time.monotonic() < deadline
            time.sleep(0.01)
        listed = channel.unary_unary("/fvs.v1.SceneService/ListScenes")
        _, outcome = refused(lambda: listed(b"", metadata=with_key(tenant)))
        assert (outcome.code, outcome.retryable) == ("limit-exceeded", True)
        listed(b"", metadata=(("authorization", f"Bearer {other}"),))
        for call in held:
            call.cancel()
        never.set()


@pytest.mark.parametrize("of_transport", [False, True])
def test_calls_of_all_tenants_have_a_limit(
    open_rpc: Callable[..., tuple[Any, int]],
    tenant: Any,
    monkeypatch: pytest.MonkeyPatch,
    of_transport: bool,
) -> None:
    monkeypatch.setattr(calls, "MAX_CALLS", 2)
    if of_transport:
        monkeypatch.setattr(server, "_CALLS_OF_TRANSPORT", 2)
    _, port = open_rpc()
    never = threading.Event()

    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        raw = channel.stream_stream("/fvs.v1.ImageService/UploadImage")
        held = [raw(silent(never), metadata=with_key(tenant)) for _ in range(3)]
        wait_until(lambda: any(call.done() for call in held))
        listed = channel.unary_unary("/fvs.v1.SceneService/ListScenes")
        with pytest.raises(grpc.RpcError) as caught:
            listed(b"", metadata=with_key(tenant))
        assert caught.value.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
        if of_transport:  # gRPC refuses them itself
            assert "Concurrent RPC limit exceeded" in caught.value.details()
        else:
            outcome = outcome_of_error(caught.value)
            assert (outcome.code, outcome.retryable, outcome.retry_after) == ("limit-exceeded", True, True)
        for call in held:
            call.cancel()
        never.set()
        wait_until(lambda: _answers(listed, tenant))


def _answers(call: Any, tenant: Any) -> bool:
    try:
        call(b"", metadata=with_key(tenant))
    except grpc.RpcError:
        return False
    return True


def test_a_key_on_hold_is_refused_as_over_rest(tenant: Any, gateway: Any) -> None:
    scene, create = tenant.scene(), tenant.transport.unary("CreateScene")
    wrong = scenes.CreateSceneRequest(scene=scenes.SceneRequest(name="a" * 1_000))
    for _ in range(gateway.settings.limits.refusals_per_key):
        assert refused(lambda: create(wrong, metadata=with_key(tenant)))[1].code == "invalid-request"
    error, outcome = refused(lambda: create(wrong, metadata=with_key(tenant)))
    assert error.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
    headers = {"Authorization": f"Bearer {tenant.key}"}
    answer = gateway.client.post("/v1/scenes", json={"name": "a"}, headers=headers)
    assert answer.status_code == 429
    problem = answer.json()
    assert (outcome.code, outcome.message, outcome.hint) == (
        problem["code"],
        problem["detail"],
        problem["hint"],
    )
    held, uploading = refused(lambda: send(tenant, upload_parts(scene, b"a" * 5_000)))
    assert (held.code(), uploading.code) == (error.code(), outcome.code)
    found = tenant.transport.unary("GetScene")(
        scenes.GetSceneRequest(scene_id=scene), metadata=with_key(tenant)
    )
    assert found.id == scene


def test_messages_have_a_limit(tenant: Any, rpc: Any, gateway: Any) -> None:
    raw = rpc.channel.unary_unary("/fvs.v1.SceneService/CreateScene")
    _, outcome = refused(lambda: raw(b"\0" * 70_000, metadata=with_key(tenant)))
    assert outcome.code == "payload-too-large"
    lists = rpc.channel.unary_unary("/fvs.v1.ViewService/RankViews")
    limit = gateway.settings.limits.json_bytes
    error, outcome = refused(lambda: lists(b"\0" * (limit + 1), metadata=with_key(tenant)))
    assert error.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
    assert (outcome.code, outcome.retryable) == ("payload-too-large", False)
    assert str(limit) in outcome.message
    with pytest.raises(grpc.RpcError) as caught:  # of which gRPC lets nothing through
        lists(b"\0" * (limit + 100_000), metadata=with_key(tenant))
    assert caught.value.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
    assert "larger than max" in caught.value.details()


def test_chunks_are_not_limited_as_lists_are(
    tenant: Any, open_rpc: Callable[..., tuple[Any, int]], gateway: Any, photograph: Callable[..., bytes]
) -> None:
    few = gateway.settings.limits.model_copy(update={"json_bytes": 2_000})
    _, port = open_rpc(limits=few)
    scene, content = tenant.scene(), photograph(16) + bytes(1_000_000)
    parts = [
        *upload_parts(scene, content, stop=0),
        *(images.UploadImageRequest(chunk=part) for part in (content[: 1 << 20], content[1 << 20 :]) if part),
    ]
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        upload = type(tenant.transport)(channel).upload_call()
        assert upload(iter(parts), timeout=60, metadata=with_key(tenant)).created


def test_few_messages_with_lists_are_read_at_once(
    open_rpc: Callable[..., tuple[Any, int]], gateway: Any, tenant: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each may be large, and larger still once it is parsed."""
    monkeypatch.setattr(calls, "_LISTS_AT_ONCE", 2)
    _, port = open_rpc()
    other = gateway.application.storage.keys.create("other", tenant_id="somebody")
    never = threading.Event()

    request = views.RankViewsRequest(scene_id=tenant.scene()).SerializeToString()
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        held = [
            channel.stream_stream("/fvs.v1.ViewService/RankViews")(silent(never), metadata=with_key(tenant))
            for _ in range(2)
        ]
        rank = channel.unary_unary("/fvs.v1.ViewService/RankViews")
        wait_until(lambda: not _ends(rank.future(request, metadata=with_key(tenant)), within_s=0.5))
        waiting = rank.future(request, metadata=with_key(tenant))
        channel.unary_unary("/fvs.v1.SceneService/ListScenes")(b"", metadata=with_key(tenant))
        assert _ends(rank.future(request, metadata=(("authorization", f"Bearer {other}"),)), within_s=20)
        assert not waiting.done()
        held[0].cancel()
        assert _ends(waiting, within_s=20)
        held[1].cancel()
        never.set()


def test_a_refused_request_leaves_memory_at_once(tenant: Any, rpc: Any) -> None:
    """By reference counting, without waiting for the cyclic garbage collector."""
    request = views.RankViewsRequest(scene_id=tenant.scene())
    for number in range(41):  # one too many
        request.ranking.candidates.items.add(id=str(number))
    content = request.SerializeToString()
    del request
    rank = rpc.channel.unary_unary("/fvs.v1.ViewService/RankViews")
    gc.collect()
    gc.disable()
    try:
        for _ in range(3):
            _, outcome = refused(lambda: rank(content, metadata=with_key(tenant)))
            assert outcome.code == "invalid-request"
        wait_until(lambda: not any(type(one) is views.RankViewsRequest for one in gc.get_objects()))
    finally:
        gc.enable()


def _ends(call: Any, within_s: float) -> bool:
    """Whether a call ends in time; one that does not is cancelled."""
    try:
        call.result(within_s)
    except grpc.FutureTimeoutError:
        call.cancel()
        return False
    except grpc.RpcError:  # such as that the scene has no model
        pass
    return True
