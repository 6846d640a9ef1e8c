"""gRPC as the client's transport, where it differs from HTTP; all else is in ``test_congruence.py``."""

import contextlib
import json
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import grpc
import pytest
from fvs_client import (
    NO_RETRIES,
    Client,
    ConnectionFailedError,
    FvsError,
    Job,
    LimitExceededError,
    NotFoundError,
    Outcome,
    PayloadTooLargeError,
    Retries,
    UnexpectedAnswerError,
    UnimplementedError,
    UploadProgress,
)
from fvs_client._sync import rpc as transport
from fvs_client.cli.app import app
from fvs_client.connection import Connection
from fvs_client.rpc import addresses, contract
from fvs_client.rpc.addresses import credentials_of, target_of
from fvs_client.rpc.routes import _STREAMED, _TABLE
from fvs_service.errors import StorageUnavailableError
from typer.testing import CliRunner

SOON = Retries(first_s=0.01, longest_s=0.05)
NEVER_AGAIN = Retries(draw=lambda: pytest.fail("The client tries again."))
SCENE = "scn_00000000000000000000000000"


@pytest.fixture
def rpc_client(rpc_url: str) -> Iterator[Client]:
    with Client(rpc_url, retries=SOON) as client:
        yield client


def test_the_client_needs_no_grpc_for_http() -> None:
    code = "import sys, fvs_client; fvs_client.Client('http://127.0.0.1:1'); sys.exit('grpc' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_the_extra_the_client_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(ValueError, match=r"pip install 'fvs-client\[grpc\]'"):
        Client("grpc://127.0.0.1:8001")


def test_an_address_needs_a_port_and_no_path() -> None:
    for url in ("grpc://quarry.example", "grpc://quarry.example:1/fvs"):
        with pytest.raises(ValueError, match="an example is grpc://"):
            Client(url)


def test_tls_trusts_what_is_given(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ssl_channel_credentials"):
        Client("grpcs://quarry.example:1", ssl_context=ssl.create_default_context())
    with pytest.raises(ValueError, match="ssl_context"):
        Client("https://quarry.example", credentials=grpc.ssl_channel_credentials())
    own = grpc.ssl_channel_credentials()
    given = Connection.resolve("grpcs://quarry.example:1", None, 5.0, None, own)
    assert (target_of(given), credentials_of(given)) == ("dns:///quarry.example:1", own)
    plain = Connection.resolve("grpc://quarry.example:1", None, 5.0, None)
    assert credentials_of(plain) is None
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "missing.pem"))
    with pytest.raises(FileNotFoundError):
        credentials_of(Connection.resolve("grpcs://quarry.example:1", None, 5.0, None))


def test_every_method_of_the_contract_answers_a_request() -> None:
    services = contract.method("SceneService", "GetScene").containing_service.file.pool
    names = {name for _, _, name in _TABLE}
    names |= {f"{method.containing_service.name}.{method.name}" for method in _STREAMED.values()}
    unused = {"ImageService.GetUpload", "JobService.WatchJob"}  # for resuming; waiting follows the events
    for service in {name.partition(".")[0] for name in names}:
        methods = services.FindServiceByName(f"fvs.v1.{service}").methods
        assert {f"{service}.{method.name}" for method in methods} - unused <= names


def test_no_service_is_said() -> None:
    with (
        Client("grpc://127.0.0.1:1", retries=SOON) as nobody,
        pytest.raises(ConnectionFailedError, match="There is no answer at grpc"),
    ):
        nobody.capabilities()


def test_the_command_line_takes_the_address(rpc_url: str) -> None:
    listed = CliRunner().invoke(app, ["--url", rpc_url, "--api-key", "", "scenes", "list", "--json"])
    assert listed.exit_code == 0, listed.output
    missing = CliRunner().invoke(app, ["--url", rpc_url, "jobs", "show", "job_none"])
    assert missing.exit_code == 6


def test_waiting_and_events_outlive_silence(
    rpc_client: Client, gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport, "_HEARTBEAT_S", 0.1)
    scene = rpc_client.scenes.create("quarry")
    job = scene.update()
    ledger, lease = gateway.application.storage.ledger, gateway.lease(scene.id)

    def work() -> None:
        ledger.start(lease, job.id, job.attempt)
        ledger.report(lease, job.id, "features", 0.5, eta_s=1.0)
        ledger.succeed(lease, job.id)

    worker = threading.Timer(1.0, work)  # after several heartbeats
    worker.start()
    seen: list[Job] = []
    assert job.wait(on_progress=seen.append).ended
    worker.join()
    assert seen[-1].progress == 1.0
    numbers = []
    threading.Timer(1.0, scene.delete).start()
    for event in scene.events():
        numbers.append(event.number)
    assert numbers == sorted(set(numbers))
    assert event.kind == "scene.deleted"
    with pytest.raises(NotFoundError):
        scene.refresh()


@pytest.mark.parametrize("bytes_beyond", [1, 1_000_000])
def test_a_request_that_is_too_large_is_refused_at_once(
    rpc_url: str, gateway: Any, bytes_beyond: int
) -> None:
    digests = ["sha256:" + "0" * 64] * ((gateway.settings.limits.json_bytes + bytes_beyond) // 73 + 1)
    with Client(rpc_url, retries=NEVER_AGAIN) as client:
        scene = client.scenes.create("quarry")
        with pytest.raises(PayloadTooLargeError, match="has more") as caught:
            scene.images.check(digests)
    assert (caught.value.status, caught.value.retryable) == (413, False)
    assert caught.value.hint.startswith("Split it into several calls")


def test_an_answer_that_is_too_large_is_said_at_once(rpc_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(addresses, "_MOST_BYTES", 10)
    with (
        Client(rpc_url, retries=NEVER_AGAIN) as client,
        pytest.raises(UnexpectedAnswerError, match="it is too large"),
    ):
        client.capabilities()


@pytest.fixture
def slow_link(rpc_url: str) -> Iterator[str]:
    """The address of a relay that needs a second for the first bytes of a connection."""
    host, port = rpc_url.removeprefix("grpc://").split(":")
    listening = socket.create_server(("127.0.0.1", 0))

    def pump(source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while content := source.recv(65_536):
                target.sendall(content)
            target.shutdown(socket.SHUT_WR)

    def relay(near: socket.socket) -> None:
        time.sleep(1.0)
        with near, socket.create_connection((host, int(port))) as far:
            there = threading.Thread(target=pump, args=(near, far), daemon=True)
            there.start()
            pump(far, near)
            there.join()

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=relay, args=(listening.accept()[0],), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    yield f"grpc://127.0.0.1:{listening.getsockname()[1]}"
    listening.close()


def test_a_slow_link_is_no_missing_service(slow_link: str) -> None:
    with Client(slow_link, retries=NO_RETRIES) as client:
        assert client.capabilities().methods


class BreakingService:
    """Takes uploads, and breaks off the first one after two chunks."""

    def __init__(self) -> None:
        self.received = b""
        self.size_bytes = 0
        self.offsets: list[int] = []

    def upload(self, messages: Iterator[bytes], context: grpc.ServicerContext) -> bytes:
        kind = contract.message("UploadImageRequest")
        first = kind.FromString(next(messages)).upload
        self.size_bytes = first.size_bytes
        self.offsets.append(first.offset_bytes)
        for number, content in enumerate(messages, 1):
            self.received += kind.FromString(content).chunk
            if len(self.offsets) == 1 and number == 2:
                context.abort(grpc.StatusCode.UNAVAILABLE, "Connection reset by peer")
        answer = contract.message("UploadImageResponse")()
        answer.image.digest = first.digest
        answer.image.scene_id = first.scene_id
        answer.image.verdict = answer.image.registration = 1
        answer.image.received_at.GetCurrentTime()
        return bytes(answer.SerializeToString())

    def get_upload(self, _content: bytes, _context: grpc.ServicerContext) -> bytes:
        answer = contract.message("Upload")(size_bytes=self.size_bytes, offset_bytes=len(self.received))
        return bytes(answer.SerializeToString())

    def check(self, content: bytes, _context: grpc.ServicerContext) -> bytes:
        asked = contract.message("CheckImagesRequest").FromString(content).check.digests
        return bytes(contract.message("DigestAnswer")(missing=asked).SerializeToString())


@pytest.fixture
def breaking() -> Iterator[tuple[BreakingService, str]]:
    service = BreakingService()
    handlers = {
        "UploadImage": grpc.stream_unary_rpc_method_handler(service.upload),
        "GetUpload": grpc.unary_unary_rpc_method_handler(service.get_upload),
        "CheckImages": grpc.unary_unary_rpc_method_handler(service.check),
    }
    with ThreadPoolExecutor(4) as pool:
        server = grpc.server(pool)
        server.add_generic_rpc_handlers(
            (grpc.method_handlers_generic_handler("fvs.v1.ImageService", handlers),)
        )
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        yield service, f"grpc://127.0.0.1:{port}"
        server.stop(None).wait()


def test_a_method_that_the_service_lacks_is_said_at_once(breaking: tuple[BreakingService, str]) -> None:
    _, url = breaking
    with Client(url, retries=NEVER_AGAIN) as client:
        with pytest.raises(UnimplementedError, match="has no method for GET /v1/capabilities") as caught:
            client.capabilities()
        assert (caught.value.status, caught.value.retryable) == (501, False)
        assert "upgrade the service" in caught.value.hint
        with pytest.raises(UnimplementedError):
            next(iter(client.scenes.list()))


@pytest.fixture
def full() -> Iterator[tuple[threading.Event, str]]:
    """The address of a server that has as many calls as it takes, until the event is set."""
    done, held = threading.Event(), threading.Event()

    def answer(_content: bytes, context: grpc.ServicerContext) -> bytes:
        if "hold" in dict(context.invocation_metadata()):
            held.set()
            done.wait(60)
        return b""

    handlers = {"ListScenes": grpc.unary_unary_rpc_method_handler(answer)}
    with ThreadPoolExecutor(2) as pool:
        server = grpc.server(pool, maximum_concurrent_rpcs=1)
        server.add_generic_rpc_handlers(
            (grpc.method_handlers_generic_handler("fvs.v1.SceneService", handlers),)
        )
        port = server.add_insecure_port("127.0.0.1:0")
        server.start()
        with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
            call = channel.unary_unary("/fvs.v1.SceneService/ListScenes").future(
                b"", metadata=(("hold", "yes"),)
            )
            assert held.wait(20)
            yield done, f"grpc://127.0.0.1:{port}"
            done.set()
            call.result(20)
        server.stop(None).wait()


def test_a_service_with_too_many_calls_is_asked_again(full: tuple[threading.Event, str]) -> None:
    done, url = full
    with Client(url, retries=NO_RETRIES) as client, pytest.raises(LimitExceededError) as caught:
        next(iter(client.scenes.list()))
    assert (caught.value.status, caught.value.retryable, caught.value.retry_after_s) == (429, True, 1)
    threading.Timer(0.5, done.set).start()
    with Client(url, retries=SOON) as client:
        assert list(client.scenes.list()) == []


def test_an_upload_that_breaks_off_goes_on_where_the_service_has_it(
    breaking: tuple[BreakingService, str], tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    service, url = breaking
    content = photograph(1) + bytes(1_500_000)
    (tmp_path / "a.jpg").write_bytes(content)
    seen: list[UploadProgress] = []
    with Client(url, retries=SOON) as client:
        report = client.scenes.images(SCENE).upload(tmp_path, on_progress=seen.append)
    assert [file.outcome for file in report.files] == [Outcome.SENT]
    assert service.offsets == [0, 2 * transport._CHUNK_BYTES]
    assert service.received == content
    assert seen[-1].bytes_done == len(content)


def test_an_upload_from_memory_goes_on_too(breaking: tuple[BreakingService, str]) -> None:
    service, url = breaking
    content = bytes(range(256)) * 5_000
    with Client(url, retries=SOON) as client:
        client.scenes.images(SCENE).put(content)
    assert service.offsets == [0, 2 * transport._CHUNK_BYTES]
    assert service.received == content


def test_calls_are_logged_with_what_they_are_about_and_why_they_fail(
    rpc_client: Client, gateway: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise StorageUnavailableError("The database cannot be reached.") from OSError("connection refused")

    scene = rpc_client.scenes.create("quarry")
    scene.refresh()
    monkeypatch.setattr(gateway.application.scenes, "get", fail)
    with pytest.raises(FvsError):
        scene.refresh()
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines() if line.startswith("{")]
    calls = [line for line in lines if line["event"] == "request" and line["path"].endswith("/GetScene")]
    assert {call["scene"] for call in calls} == {scene.id}
    assert (calls[0]["status"], calls[-1]["status"]) == ("OK", "UNAVAILABLE")
    assert (calls[-1]["code"], calls[-1]["reason"]) == ("unavailable", "connection refused")
