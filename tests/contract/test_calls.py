"""What only gRPC has: streams, deadlines, messages of other versions, health, reflection, a stop."""

import asyncio
import io
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import numpy as np
import pytest
from contract_calls import CHUNK, digest_of, refused, send, upload_parts, wait_until, with_key
from fvs.v1 import images_pb2 as images
from fvs.v1 import jobs_pb2 as jobs
from fvs.v1 import scenes_pb2 as scenes
from fvs.v1 import views_pb2 as views
from fvs_service.errors import StorageUnavailableError
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub
from grpc_reflection.v1alpha.reflection_pb2 import ServerReflectionRequest, ServerReflectionResponse
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from fvs_engine.candidates import CandidateScore
from fvs_schema.candidates import CandidateStatus


def _offset(tenant: Any, scene: str, content: bytes) -> int:
    request = images.GetUploadRequest(scene_id=scene, digest=digest_of(content))
    upload = tenant.transport.unary("GetUpload")(request, metadata=with_key(tenant))
    return int(upload.offset_bytes)


def test_an_upload_that_stops_half_way_resumes_where_it_stopped(
    tenant: Any, photograph: Callable[..., bytes]
) -> None:
    scene, content = tenant.scene(), photograph(11)
    error, outcome = refused(lambda: send(tenant, upload_parts(scene, content, stop=2 * CHUNK)))
    assert error.code() is grpc.StatusCode.INVALID_ARGUMENT
    assert outcome.code == "malformed-request"
    assert "GetUpload" in outcome.hint
    assert _offset(tenant, scene, content) == 2 * CHUNK

    _, wrong = refused(lambda: send(tenant, upload_parts(scene, content, offset=CHUNK)))
    assert wrong.code == "offset-mismatch"
    assert _offset(tenant, scene, content) == 2 * CHUNK  # nothing is lost by that

    sent = send(tenant, upload_parts(scene, content, offset=2 * CHUNK))
    assert sent.created
    assert sent.image.verdict == images.VERDICT_ACCEPTED
    with pytest.raises(grpc.RpcError) as caught:
        _offset(tenant, scene, content)
    assert caught.value.code() is grpc.StatusCode.NOT_FOUND


def test_an_upload_whose_client_vanishes_resumes_where_it_stopped(
    tenant: Any, photograph: Callable[..., bytes]
) -> None:
    scene, content = tenant.scene(), photograph(12)
    gone = threading.Event()

    def endless() -> Iterator[Any]:
        yield from upload_parts(scene, content, stop=2 * CHUNK)
        gone.wait(60)

    received = tenant.gateway.app.state.metrics.received_bytes._value.get
    before = received()
    call = tenant.transport.upload_call().future(endless(), metadata=with_key(tenant))
    wait_until(lambda: received() >= before + 2 * CHUNK)
    call.cancel()
    gone.set()
    wait_until(lambda: any(tenant.gateway.settings.uploads.rglob(f"*{digest_of(content)[7:]}*")))
    assert send(tenant, upload_parts(scene, content, offset=_offset(tenant, scene, content))).created
    assert not list(tenant.gateway.settings.uploads.rglob(f"upl_{scene}_*.part"))


def test_an_upload_that_lies_is_refused_and_nothing_of_it_is_kept(
    tenant: Any, photograph: Callable[..., bytes]
) -> None:
    scene, content = tenant.scene(), photograph(13)
    for given, code in (
        ({"digest": f"sha256:{'1' * 64}"}, "digest-mismatch"),
        ({"size_bytes": 100}, "invalid-request"),
        ({"digest": "sha256:x"}, "invalid-request"),
        ({"size_bytes": 10**12}, "payload-too-large"),
    ):
        _, outcome = refused(lambda given=given: send(tenant, upload_parts(scene, content, **given)))
        assert outcome.code == code
    _, outcome = refused(lambda: send(tenant, iter(())))
    assert outcome.code == "malformed-request"
    chunk = images.UploadImageRequest(chunk=b"x")
    _, outcome = refused(lambda: send(tenant, iter([chunk])))
    assert outcome.code == "invalid-request"
    assert not list(tenant.gateway.settings.uploads.rglob(f"upl_{scene}_*.part"))
    assert tenant.call("ListImages", scene_id=scene).result["items"] == []


@pytest.mark.parametrize("method", ["ListScenes", "WatchEvents"])
def test_a_call_whose_request_does_not_come_ends(
    open_rpc: Callable[..., tuple[Any, int]], tenant: Any, method: str
) -> None:
    _, port = open_rpc(upload_idle_s=1.0)
    metadata = with_key(tenant)
    never = threading.Event()

    def nothing() -> Iterator[bytes]:
        never.wait(60)
        yield from ()

    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        call = channel.stream_stream(f"/fvs.v1.SceneService/{method}")
        held = call(nothing(), timeout=60, metadata=metadata)
        with pytest.raises(grpc.RpcError) as caught:
            next(held)
        never.set()
        assert caught.value.code() is grpc.StatusCode.UNAVAILABLE
        assert "No request arrived within 1 s" in caught.value.details()
        with pytest.raises(grpc.RpcError) as caught:
            next(call(iter(()), timeout=60, metadata=metadata))
        assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT


@pytest.mark.parametrize("chunk", [b"", b"x"])
def test_an_upload_in_tiny_chunks_is_refused(tenant: Any, chunk: bytes) -> None:
    def tiny() -> Iterator[Any]:
        yield next(upload_parts(scene, b"x" * 100_000))
        while True:
            yield images.UploadImageRequest(chunk=chunk)

    scene = tenant.scene()
    error, outcome = refused(lambda: send(tenant, tiny()))
    assert error.code() is grpc.StatusCode.INVALID_ARGUMENT
    assert "chunks are too small" in outcome.message


def test_another_tenant_does_not_see_an_upload(
    tenant: Any, gateway: Any, photograph: Callable[..., bytes]
) -> None:
    scene, content = tenant.scene(), photograph(14)
    refused(lambda: send(tenant, upload_parts(scene, content, stop=CHUNK)))
    other = gateway.application.storage.keys.create("other", tenant_id="somebody")
    request = images.GetUploadRequest(scene_id=scene, digest=digest_of(content))
    call = tenant.transport.unary("GetUpload")
    _, outcome = refused(lambda: call(request, metadata=(("authorization", f"Bearer {other}"),)))
    assert outcome.code == "not-found"


def test_a_field_of_a_newer_client_is_refused(tenant: Any, rpc: Any) -> None:
    scene = scenes.SceneRequest(name="a").SerializeToString() + b"\xf8\x07\x01"  # field 127
    content = b"\x0a" + bytes([len(scene)]) + scene
    raw = rpc.channel.unary_unary("/fvs.v1.SceneService/CreateScene")
    _, outcome = refused(lambda: raw(content, metadata=with_key(tenant)))
    assert outcome.code == "invalid-request"
    assert outcome.message == "scene: there is no field 127."
    assert "newer" in outcome.hint
    _, outcome = refused(lambda: raw(b"\xff\xff", metadata=with_key(tenant)))
    assert outcome.code == "malformed-request"


def test_an_unknown_field_far_back_in_a_list_is_refused(tenant: Any, rpc: Any) -> None:
    """It is named only among the first items, which bounds the search."""
    items = b"\x0a\x00" * 1_500 + b"\x0a\x03\xf8\x07\x01"
    for content, message in (
        (items[-5:] + items[:-5], "ranking.candidates.items: there is no field 127."),
        (items, "There is an unknown field."),
    ):
        candidates = views.RankViewsRequest(scene_id=tenant.scene())
        candidates.ranking.candidates.MergeFromString(content)
        raw = rpc.channel.unary_unary("/fvs.v1.ViewService/RankViews")
        _, outcome = refused(lambda: raw(candidates.SerializeToString(), metadata=with_key(tenant)))  # noqa: B023
        assert (outcome.code, outcome.message) == ("invalid-request", message)


def test_a_value_of_a_newer_client_is_refused(tenant: Any) -> None:
    request = jobs.CreateJobRequest(scene_id=tenant.scene(), job=jobs.JobRequest(kind=99))
    call = tenant.transport.unary("CreateJob")
    _, outcome = refused(lambda: call(request, metadata=with_key(tenant)))
    assert outcome.code == "invalid-request"
    assert outcome.fields == ("kind",)
    assert "no value 99" in outcome.message


@pytest.mark.parametrize("method", ["SceneService/CreateScene", "SceneService/WatchEvents"])
def test_a_caller_without_a_key_is_refused_before_its_request_has_arrived(rpc: Any, method: str) -> None:
    never = threading.Event()

    def nothing() -> Iterator[bytes]:
        never.wait(60)
        yield from ()

    raw = rpc.channel.stream_stream(f"/fvs.v1.{method}")
    _, outcome = refused(lambda: next(raw(nothing(), timeout=20)))
    never.set()
    assert outcome.code == "unauthenticated"


def test_the_deadline_is_the_timeout_of_the_ranking(tenant: Any, gateway: Any) -> None:
    scene = tenant.scene()
    gateway.model(scene, headers=tenant.headers)
    asked = gateway.runners.asked
    call = tenant.transport.unary("RankViews")
    request = views.RankViewsRequest(scene_id=scene)
    call(request, timeout=50, metadata=with_key(tenant))
    assert 0 < asked[-1].timeout_s < 60  # gRPC sends it rounded up
    call(request, metadata=with_key(tenant))
    assert asked[-1].timeout_s == gateway.settings.limits.ranking_timeout_s
    before = len(asked)
    with pytest.raises(grpc.RpcError) as caught:
        call(request, timeout=1e-6, metadata=with_key(tenant))
    assert caught.value.code() is grpc.StatusCode.DEADLINE_EXCEEDED
    assert len(asked) == before


def test_a_deadline_ends_a_stream(tenant: Any, gateway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tenant.scene()
    gateway.model(scene, headers=tenant.headers)
    began, closed = threading.Event(), threading.Event()

    async def slow(_request: Any) -> Any:
        began.set()
        try:
            yield (CandidateScore("orbit-0000", 1.0, CandidateStatus.RANKED, 1.0),)
            await asyncio.sleep(60)
        finally:
            closed.set()

    monkeypatch.setattr(gateway.runners, "stream", slow)
    stream = tenant.transport.stream("StreamRankViews")(
        views.StreamRankViewsRequest(scene_id=scene), timeout=2, metadata=with_key(tenant)
    )
    with pytest.raises(grpc.RpcError) as caught:
        list(stream)
    assert caught.value.code() is grpc.StatusCode.DEADLINE_EXCEEDED
    assert closed.wait(60) or not began.is_set()


def test_a_watched_job_is_streamed_until_it_has_ended(tenant: Any, gateway: Any) -> None:
    scene = tenant.scene()
    job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
    watching = tenant.transport.stream("WatchJob")(
        jobs.WatchJobRequest(job_id=job), timeout=60, metadata=with_key(tenant)
    )
    assert next(watching).state == jobs.JOB_STATE_QUEUED
    lease = gateway.lease(scene)
    gateway.application.storage.ledger.start(lease, job, 1)
    assert next(watching).state == jobs.JOB_STATE_RUNNING
    gateway.application.storage.ledger.succeed(lease, job)
    gateway.application.storage.leases.release(lease)
    assert [one.state for one in watching] == [jobs.JOB_STATE_SUCCEEDED]
    again = tenant.transport.stream("WatchJob")(
        jobs.WatchJobRequest(job_id=job), timeout=60, metadata=with_key(tenant)
    )
    assert [one.state for one in again] == [jobs.JOB_STATE_SUCCEEDED]


def test_the_events_of_a_scene_end_when_it_is_deleted(tenant: Any) -> None:
    scene = tenant.scene()
    watching = tenant.transport.stream("WatchEvents")(
        scenes.WatchEventsRequest(scene_id=scene), timeout=60, metadata=with_key(tenant)
    )
    first = next(watching)
    tenant.call("ChangeScene", {"name": "b"}, scene_id=scene)
    tenant.call("DeleteScene", scene_id=scene)
    kinds = [first.kind, *(event.kind for event in watching)]
    assert kinds[0] == 1  # scene.created
    assert kinds[-1] == 3  # scene.deleted


def test_a_client_that_vanishes_leaves_its_streams(tenant: Any, gateway: Any, rpc_port: int) -> None:
    scene = tenant.scene()
    job = tenant.call("CreateJob", {"kind": "update"}, scene_id=scene).result["id"]
    open_streams = gateway.app.state.metrics.streams._value.get
    wait_until(lambda: open_streams() == 0)  # those of other tests have ended
    with grpc.insecure_channel(f"127.0.0.1:{rpc_port}") as channel:
        theirs = type(tenant.transport)(channel)
        calls = [
            theirs.stream("WatchJob")(jobs.WatchJobRequest(job_id=job), metadata=with_key(tenant)),
            theirs.stream("WatchEvents")(
                scenes.WatchEventsRequest(scene_id=scene), metadata=with_key(tenant)
            ),
        ]
        for call in calls:
            next(call)
        assert open_streams() == 2
    wait_until(lambda: open_streams() == 0)


def test_downloads_have_ranges(tenant: Any, photograph: Callable[..., bytes]) -> None:
    scene, content = tenant.scene(), photograph(15)
    digest = tenant.upload(scene, content).result["digest"]
    download = tenant.transport.stream("DownloadImage")

    def read(**span: int) -> tuple[Any, bytes]:
        request = images.DownloadImageRequest(scene_id=scene, digest=digest, **span)
        first, *parts = download(request, metadata=with_key(tenant))
        return first.info, b"".join(part.chunk for part in parts)

    info, whole = read()
    assert whole == content
    assert (info.media_type, info.size_bytes) == ("image/jpeg", len(content))
    assert f"sha256:{info.sha256}" == digest
    assert read(start=10, stop=20)[1] == content[10:20]
    assert read(start=10, stop=10**9)[1] == content[10:]
    error, outcome = refused(lambda: read(start=len(content)))
    assert error.code() is grpc.StatusCode.OUT_OF_RANGE
    assert outcome.code == "range-not-satisfiable"


def test_health_needs_no_key_and_knows_the_services(rpc: Any) -> None:
    health = HealthStub(rpc.channel)
    for name in ("", "fvs.v1.ViewService"):
        assert health.Check(HealthCheckRequest(service=name)).status == HealthCheckResponse.SERVING
    with pytest.raises(grpc.RpcError) as caught:
        health.Check(HealthCheckRequest(service="fvs.v9.Nothing"))
    assert caught.value.code() is grpc.StatusCode.NOT_FOUND
    watching = health.Watch(HealthCheckRequest(), timeout=60)
    assert next(watching).status == HealthCheckResponse.SERVING
    watching.cancel()


@pytest.mark.parametrize("version", ["v1", "v1alpha"])
def test_reflection_describes_the_services(rpc: Any, version: str) -> None:
    """Also itself: programs such as grpcurl describe every service that is listed."""
    ask = rpc.channel.stream_stream(
        f"/grpc.reflection.{version}.ServerReflection/ServerReflectionInfo",
        ServerReflectionRequest.SerializeToString,
        ServerReflectionResponse.FromString,
    )
    (answer,) = ask(iter([ServerReflectionRequest(list_services="")]))
    names = {service.name for service in answer.list_services_response.service}
    assert {
        *(f"fvs.v1.{kind}Service" for kind in ("Scene", "Image", "Job", "Snapshot", "View", "Capability")),
        *("grpc.reflection.v1.ServerReflection", "grpc.reflection.v1alpha.ServerReflection"),
    } < names
    for name in names:
        (answer,) = ask(iter([ServerReflectionRequest(file_containing_symbol=name)]))
        found = FileDescriptorProto.FromString(answer.file_descriptor_response.file_descriptor_proto[0])
        assert name in {f"{found.package}.{service.name}" for service in found.service}


def test_calls_are_counted_and_have_the_id_that_was_offered(tenant: Any, gateway: Any) -> None:
    call = tenant.transport.unary("GetScene")
    with pytest.raises(grpc.RpcError) as caught:
        call(scenes.GetSceneRequest(scene_id="none"), metadata=(*with_key(tenant), ("x-request-id", "mine")))
    assert dict(caught.value.trailing_metadata())["x-request-id"] == "mine"
    counted = {"method": "RPC", "route": "/fvs.v1.SceneService/GetScene", "status": "NOT_FOUND"}
    metrics, deadline = gateway.app.state.metrics.registry, time.monotonic() + 20
    while not metrics.get_sample_value("fvs_requests_total", counted):  # counted after the answer is sent
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_calls_are_logged_with_what_they_are_about_and_why_they_fail(
    tenant: Any, gateway: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise StorageUnavailableError("The database cannot be reached.") from OSError("connection refused")

    scene = tenant.scene()
    tenant.call("GetScene", scene_id=scene)
    monkeypatch.setattr(gateway.application.scenes, "get", fail)
    assert tenant.call("GetScene", scene_id=scene).code == "unavailable"
    calls: list[dict[str, Any]] = []

    def logged() -> bool:  # after the answer is sent
        lines = [json.loads(line) for line in capsys.readouterr().err.splitlines() if line.startswith("{")]
        calls.extend(line for line in lines if line.get("path", "").endswith("/GetScene"))
        return len(calls) >= 2

    wait_until(logged)
    assert {call["scene"] for call in calls} == {scene}
    assert (calls[0]["status"], calls[-1]["status"]) == ("OK", "UNAVAILABLE")
    assert (calls[-1]["code"], calls[-1]["reason"]) == ("unavailable", "connection refused")


def test_subtitles_are_one_message_before_their_video(tenant: Any, photograph: Callable[..., bytes]) -> None:
    scene, content = tenant.scene(), photograph(17)
    call = tenant.transport.unary("SetSubtitles")
    request = images.SetSubtitlesRequest(scene_id=scene, digest=digest_of(content), subtitles=b"1" * 200_000)
    for _ in range(2):
        call(request, metadata=with_key(tenant))
    tenant.upload(scene, content)
    _, outcome = refused(lambda: call(request, metadata=with_key(tenant)))
    assert outcome.code == "conflict"


def test_a_mask_is_a_png_in_one_message(tenant: Any, photograph: Callable[..., bytes]) -> None:
    scene, content = tenant.scene(), photograph(16)
    digest = tenant.upload(scene, content).result["digest"]
    out, text = io.BytesIO(), PngInfo()
    text.add_text("Comment", "large" * 40_000)
    Image.fromarray(np.tile(np.arange(96) < 40, (64, 1))).save(out, "PNG", pnginfo=text)
    call = tenant.transport.unary("SetMask")
    request = images.SetMaskRequest(scene_id=scene, digest=digest, mask=out.getvalue())
    for _ in range(2):
        image = call(request, metadata=with_key(tenant))
        assert (image.mask, image.number) == (digest_of(out.getvalue()), 2)
    _, outcome = refused(
        lambda: call(images.SetMaskRequest(scene_id=scene, digest=digest), metadata=with_key(tenant))
    )
    assert outcome.code == "invalid-request"
