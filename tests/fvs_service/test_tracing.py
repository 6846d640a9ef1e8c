"""Traces from a request to the stages of its job, as an OpenTelemetry collector receives them."""

import gzip
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import grpc
import pytest
from fvs.v1 import jobs_pb2 as jobs
from fvs.v1.jobs_pb2_grpc import JobServiceStub
from fvs_service.gateway.rpc.calls import Gateway as RpcGateway
from fvs_service.host.protocol.connection import Connection, RunnerGoneError
from fvs_service.serving.rpc_server import RpcServer
from fvs_service.tracing import Tracing, traceparent
from granted_scenes import GrantedScenes
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import (
    ExportTraceServiceRequest,
    ExportTraceServiceResponse,
)

TRACE = "0af7651916cd43dd8448eb211c80319c"
PARENT = f"00-{TRACE}-b7ad6b7169203331-01"


class Collector:
    """Receives spans over OTLP."""

    def __init__(self) -> None:
        self.spans: dict[str, Any] = {}
        self.services: set[str] = set()

    def receive(self, content: bytes) -> None:
        for one in ExportTraceServiceRequest.FromString(content).resource_spans:
            about = {item.key: item.value.string_value for item in one.resource.attributes}
            self.services.add(about["service.name"])
            for scope in one.scope_spans:
                self.spans.update({span.name: span for span in scope.spans})

    def attributes(self, name: str) -> dict[str, Any]:
        found = {}
        for item in self.spans[name].attributes:
            found[item.key] = getattr(item.value, item.value.WhichOneof("value"))
        return found

    def below(self, name: str, parent: str) -> bool:
        return bool(self.spans[name].parent_span_id == self.spans[parent].span_id)


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> Iterator[Collector]:
    received = Collector()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                content = gzip.decompress(content)
            received.receive(content)
            self.send_response(200)
            self.end_headers()
            self.wfile.write(ExportTraceServiceResponse().SerializeToString())

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", f"http://127.0.0.1:{server.server_port}")
    monkeypatch.delenv("OTEL_SERVICE_NAME", raising=False)
    yield received
    server.shutdown()
    thread.join()
    server.server_close()


class FailingRunner:
    """Comes to two stages, and says that the training failed."""

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        host, port = self._socket.getsockname()
        self.endpoint = f"{host}:{port}/secret"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._socket.close()

    def _serve(self) -> None:
        with suppress(OSError, RunnerGoneError), closing(Connection(self._socket.accept()[0])) as connection:
            connection.receive()
            connection.receive()
            for stage in ("features", "features", "training"):
                connection.send({"part": {"kind": "progress", "stage": stage, "share": 0.5}})
            failure = {"code": "training-failed", "message": "It diverged.", "hint": "", "retryable": True}
            connection.send({"error": failure})


def _work(gateway: Any, job: str) -> None:
    runner = FailingRunner()
    GrantedScenes(gateway, runner.endpoint).turns().run(gateway.take(job))
    runner.close()
    assert gateway.client.get(f"/v1/jobs/{job}").json()["state"] == "failed"


def test_a_trace_goes_from_the_request_to_the_stages_of_the_job(
    collector: Collector, open_gateway: Callable[..., Any]
) -> None:
    gateway = open_gateway()
    scene, headers = gateway.scene(), {"traceparent": PARENT, "X-Request-Id": "mine"}
    job = gateway.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": "update"}, headers=headers)
    _work(gateway, job.json()["id"])
    gateway.application.storage.tracing.close()

    asked = "POST /v1/scenes/{scene_id}/jobs"
    trace = [asked, "job: update", "stage: restore", "stage: features", "stage: training"]
    assert {collector.spans[name].trace_id.hex() for name in trace} == {TRACE}
    assert collector.spans[asked].parent_span_id.hex() == PARENT.split("-")[2]
    assert collector.below("job: update", asked)
    assert all(collector.below(stage, "job: update") for stage in trace[2:])
    assert collector.attributes(asked)["fvs.request_id"] == "mine"
    assert collector.attributes(asked)["http.response.status_code"] == 202
    assert collector.attributes("job: update")["fvs.job_id"] == job.json()["id"]
    assert collector.attributes("job: update")["error.type"] == "training-failed"
    assert "error.type" not in collector.attributes("stage: features")
    assert collector.services == {"fvs-gateway"}
    assert not any(name.endswith(("livez", "readyz", "metrics")) for name in collector.spans)


def test_a_call_over_grpc_is_traced_too(collector: Collector, open_gateway: Callable[..., Any]) -> None:
    gateway = open_gateway(grpc_port=0)
    state, portal = gateway.app.state, gateway.client.portal
    scene = gateway.scene()

    async def start() -> tuple[RpcServer, int]:
        parts = RpcGateway.of(state, gateway.settings.upload_idle_s)
        server = RpcServer(parts, gateway.settings)
        return server, await server.start()

    server, port = portal.call(start)
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        request = jobs.CreateJobRequest(scene_id=scene, job=jobs.JobRequest(kind=jobs.JOB_KIND_UPDATE))
        job = JobServiceStub(channel).CreateJob(request, metadata=(("traceparent", PARENT),), timeout=60)
        with pytest.raises(grpc.RpcError):
            JobServiceStub(channel).GetJob(jobs.GetJobRequest(job_id="none"), timeout=60)
    _work(gateway, job.id)
    portal.call(server.stop, 1.0)
    gateway.application.storage.tracing.close()

    asked = "fvs.v1.JobService/CreateJob"
    assert collector.spans[asked].trace_id.hex() == TRACE
    assert collector.below("job: update", asked)
    assert collector.below("stage: training", "job: update")
    assert collector.attributes(asked)["rpc.response.status_code"] == "OK"
    refused = collector.attributes("fvs.v1.JobService/GetJob")
    assert refused["rpc.response.status_code"] == "NOT_FOUND"
    assert "error.type" not in refused  # it is the caller's


def test_spans_know_what_is_around_them_and_what_failed(collector: Collector) -> None:
    tracing = Tracing.of_environment("test")
    with tracing.span("outer", kind="SERVER") as outer:
        outer.name("renamed")
        assert (traceparent() or "").startswith("00-")
        with pytest.raises(KeyError), tracing.span("inner"):
            raise KeyError
        with tracing.span(
            "next request", kind="SERVER"
        ):  # over a connection whose last one is still open here
            pass
        with pytest.raises(ValueError, match="known"), tracing.span("known", expected=(ValueError,)):
            raise ValueError("known")
    assert traceparent() is None
    tracing.close()
    assert collector.below("inner", "renamed")
    assert not collector.spans["next request"].parent_span_id
    assert collector.spans["next request"].trace_id != collector.spans["renamed"].trace_id
    assert collector.attributes("inner")["error.type"] == "KeyError"
    assert not collector.attributes("known")
    assert collector.services == {"test"}


@pytest.mark.system
def test_without_a_collector_nothing_is_recorded_and_the_sdk_is_not_loaded() -> None:
    code = (
        "import sys, fvs_service.host.worker.process, fvs_service.serving.gateway\n"
        "from fvs_service.tracing import Tracing, traceparent\n"
        "with Tracing.of_environment('test').span('a') as span:\n"
        "    span.name('b'); span.add({'c': 1}); span.fail('d'); assert traceparent() is None\n"
        "sys.exit('opentelemetry.sdk' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_the_extra_the_service_says_how_to_get_it(
    collector: Collector, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    with Tracing.of_environment("test").span("a"):
        assert traceparent() is None
    assert "extra `otel`" in capsys.readouterr().err
    assert not collector.spans


def test_a_disabled_sdk_records_nothing(collector: Collector, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OTEL_SDK_DISABLED", " True ")  # as the SDK reads it
    tracing = Tracing.of_environment("test")
    with tracing.span("a"):
        assert traceparent() is None
    tracing.close()
    assert not collector.spans
