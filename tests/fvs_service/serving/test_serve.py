import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import grpc
import httpx2
import pytest
import uvicorn
from fvs_service.application import open_existing_storage, open_storage
from fvs_service.errors import ForbiddenError
from fvs_service.events.repository import last_number
from fvs_service.gateway.protection import require_protection
from fvs_service.serving.gateway import listen
from fvs_service.settings import Settings
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub
from typer.testing import CliRunner, Result

from fvs_engine.cli.app import app

PROGRAM = str(Path(sys.executable).with_name("fvs"))


def test_the_service_starts_answers_and_stops(tmp_path: Path) -> None:
    """It uses asyncio's event loop, even where uvloop is installed."""
    (tmp_path / "uvloop.py").write_text("def new_event_loop():\n    raise SystemExit('uvloop is used')\n")
    paths = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    command = [PROGRAM, "serve", "--root", str(tmp_path / "service"), "--port", "0"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    ) as process:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        try:
            assert url.startswith("http://127.0.0.1:")
            rpc_url = process.stdout.readline().strip()
            assert rpc_url.startswith("grpc://127.0.0.1:")
            with grpc.insecure_channel(rpc_url.removeprefix("grpc://")) as channel:
                health = HealthStub(channel).Check(HealthCheckRequest(), timeout=10)
                assert health.status == HealthCheckResponse.SERVING
            assert httpx2.get(f"{url}/readyz", timeout=10).status_code == 200
            scene = httpx2.post(f"{url}/v1/scenes", json={"name": "a"}).json()["id"]
            waiting = httpx2.post(f"{url}/v1/scenes/{scene}/jobs", json={"kind": "update"})
            assert waiting.json()["state"] == "queued"
            second = _fvs("serve", "--root", str(tmp_path / "service"), "--port", "0")
            assert second.exit_code == 2
            assert "Another fvs serve runs" in second.stderr
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(20) in (0, -signal.SIGTERM)


@pytest.mark.system
def test_a_service_that_starts_again_gives_no_event_a_number_that_was_lost(tmp_path: Path) -> None:
    """A power cut may have undone the last events, which clients have seen; a service cannot know."""
    root = tmp_path / "service"
    numbers = []
    for _ in range(2):
        with _served(root) as url:
            assert httpx2.post(f"{url}/v1/scenes", json={"name": "a"}).status_code == 201
        with open_existing_storage(Settings(root=root)) as storage, storage.database.reading() as session:
            numbers.append(last_number(session))
    assert numbers[1] > numbers[0] + 1_000


@contextlib.contextmanager
def _served(root: Path) -> Iterator[str]:
    """Run ``fvs serve`` with a gateway only; gives its URL."""
    command = [PROGRAM, "serve", "--role", "gateway", "--root", str(root), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(20)


def test_grpc_has_the_next_port_a_free_one_or_none() -> None:
    assert Settings(port=8000).rpc_port == 8001
    assert Settings(port=0).rpc_port == 0
    assert Settings(port=8000, grpc_port=9000).rpc_port == 9000
    assert Settings(port=8000, grpc=False).rpc_port is None


def test_grpc_has_a_process_of_its_own_where_rest_is_left_out(open_gateway: Callable[..., Any]) -> None:
    gateway = open_gateway(rest=False)
    for path in ("/livez", "/readyz", "/metrics"):
        assert gateway.client.get(path).status_code == 200
    for path in ("/v1/capabilities", "/v1/scenes"):
        assert gateway.client.get(path).status_code == 404
    assert set(gateway.client.get("/openapi.json").json()["paths"]) == {"/livez", "/readyz", "/metrics"}


def test_a_gateway_serves_something(tmp_path: Path) -> None:
    refused = _fvs("serve", "--root", str(tmp_path / "service"), "--no-rest", "--no-grpc")
    assert refused.exit_code == 2
    assert "FVS_GRPC: a gateway without REST needs gRPC" in refused.stderr


def test_answers_are_sent_at_once() -> None:
    with listen(uvicorn.Config(lambda: None, port=0)) as listening:
        listening.listen()
        with socket.create_connection(listening.getsockname()), listening.accept()[0] as accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def _fvs(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


def test_a_worker_without_a_cluster_and_a_cluster_without_ray_are_refused_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = ("serve", "--role", "worker", "--root", str(tmp_path / "service"))
    refused = _fvs(*worker)
    assert refused.exit_code != 0
    assert "FVS_CLUSTER" in refused.stderr

    monkeypatch.setenv("FVS_CLUSTER", "ray://head.example:10001")
    monkeypatch.setenv("FVS_DATABASE_URL", "postgresql://fvs@database.example/fvs")
    monkeypatch.setenv("FVS_BLOBS__URL", "s3://bucket")
    monkeypatch.setattr("fvs_service.serving.supervisor.find_spec", lambda _name: None)
    refused = _fvs(*worker)
    assert refused.exit_code != 0
    assert "extra `ray`" in refused.stderr
    assert not (tmp_path / "service").exists()


@pytest.mark.parametrize(("variable", "host"), [("HOST", "0.0.0.0"), ("ALLOWED_HOSTS", "ground.example")])
def test_where_others_get_in_a_service_without_a_key_does_not_start(
    variable: str, host: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"FVS_{variable}", host)
    refused = _fvs("serve", "--root", str(tmp_path / "service"))
    assert refused.exit_code == 2
    assert f"other machines may reach the service as {host}, and no key is valid" in refused.stderr
    assert "fvs keys create" in refused.stderr


@pytest.mark.parametrize(
    ("given", "reason"), [({"require_keys": True}, "FVS_REQUIRE_KEYS is true"), ({}, "keys were created")]
)
def test_keys_that_have_expired_let_nobody_in(given: dict[str, Any], reason: str, tmp_path: Path) -> None:
    settings = Settings(root=tmp_path / "service", **given)
    with open_storage(settings) as storage:
        storage.keys.create("old", valid_for=timedelta(seconds=-1))
    with pytest.raises(ForbiddenError, match=reason):
        require_protection(settings)
    with open_storage(settings) as storage:
        storage.keys.create("new", valid_for=timedelta(days=1))
    assert require_protection(settings) == f"Requests need an API key: {reason}."


def test_the_service_says_that_it_needs_no_key(tmp_path: Path) -> None:
    settings = Settings(root=tmp_path / "service")
    assert require_protection(settings) == "Requests need no API key until one is created."
    with open_storage(settings) as storage:
        storage.keys.create("a")
    open_to_all = settings.model_copy(update={"require_keys": False, "host": "0.0.0.0"})
    assert require_protection(open_to_all) == "Requests need no API key: FVS_REQUIRE_KEYS is false."


def test_keys_are_made_listed_and_revoked(tmp_path: Path) -> None:
    root = ["--root", str(tmp_path / "service")]
    key = _fvs("keys", "create", "drone 7", "--scope", "upload", *root).stdout.strip()
    key_id = key.split("_")[1]
    listed = _fvs("keys", "list", *root).stdout
    assert key_id in listed
    assert "drone 7" in listed
    assert key.split("_", 2)[2] not in listed
    assert _fvs("keys", "revoke", key_id, *root).exit_code == 0
    assert "revoked" in _fvs("keys", "list", *root).stdout
    assert _fvs("keys", "revoke", "unknown", *root).exit_code == 2


def test_a_variable_that_cannot_be_used_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVS_WORKER__COUNT", "many")
    refused = _fvs("keys", "list", "--root", str(tmp_path / "service"))
    assert refused.exit_code == 2
    assert "`FVS_WORKER__COUNT` must be a whole number." in refused.stderr
    monkeypatch.delenv("FVS_WORKER__COUNT")
    monkeypatch.setenv("FVS_BASEMAP__ARCHIVE", str(tmp_path / "none.pmtiles"))
    refused = _fvs("keys", "list", "--root", str(tmp_path / "service"))
    assert "FVS_BASEMAP__ARCHIVE: there is no such file." in refused.stderr
