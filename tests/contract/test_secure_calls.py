"""gRPC with TLS and mTLS, by the settings of REST; and its stop."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import certificates
import grpc
import pytest
from contract_outcome import outcome_of_error
from fvs.v1.jobs_pb2 import WatchJobRequest
from fvs.v1.jobs_pb2_grpc import JobServiceStub
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from grpc_health.v1.health_pb2_grpc import HealthStub

_WITHIN_S = 10


@pytest.fixture(scope="module")
def authorities(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """See ``certificates.made_for_tests``."""
    return certificates.made_for_tests(tmp_path_factory.mktemp("certificates"))


def _status(port: int, authority: Path | None, client: Path | None = None) -> int:
    if authority is None:
        channel = grpc.insecure_channel(f"127.0.0.1:{port}")
    else:
        credentials = grpc.ssl_channel_credentials(
            authority.read_bytes(),
            None if client is None else client.with_suffix(".key").read_bytes(),
            None if client is None else client.read_bytes(),
        )
        channel = grpc.secure_channel(f"127.0.0.1:{port}", credentials)
    with channel:
        return int(HealthStub(channel).Check(HealthCheckRequest(), timeout=_WITHIN_S).status)


def test_with_a_certificate_calls_are_encrypted(
    open_rpc: Callable[..., tuple[Any, int]], authorities: dict[str, Path]
) -> None:
    service = authorities["service"]
    _, port = open_rpc(tls_certificate=service, tls_key=service.with_suffix(".key"))
    assert _status(port, authorities["ours"]) == HealthCheckResponse.SERVING
    with pytest.raises(grpc.RpcError) as caught:
        _status(port, None)
    assert caught.value.code() is grpc.StatusCode.UNAVAILABLE


@pytest.mark.system
def test_a_client_needs_a_certificate_of_the_right_authority(
    open_rpc: Callable[..., tuple[Any, int]], authorities: dict[str, Path]
) -> None:
    service, ours = authorities["service"], authorities["ours"]
    _, port = open_rpc(tls_certificate=service, tls_key=service.with_suffix(".key"), tls_client_ca=ours)
    assert _status(port, ours, authorities["client"]) == HealthCheckResponse.SERVING
    for client in (None, authorities["stranger"]):
        with pytest.raises(grpc.RpcError) as caught:
            _status(port, ours, client)
        assert caught.value.code() is grpc.StatusCode.UNAVAILABLE


def test_a_port_in_use_is_said(open_rpc: Callable[..., tuple[Any, int]], rpc_port: int) -> None:
    from fvs_service.errors import UnavailableError

    with pytest.raises(UnavailableError, match=f"gRPC cannot listen on 127.0.0.1:{rpc_port}"):
        open_rpc(grpc_port=rpc_port)


def test_a_stop_ends_calls_with_a_reason(open_rpc: Callable[..., tuple[Any, int]], gateway: Any) -> None:
    headers = gateway.key("stopping")
    job = gateway.queue(gateway.scene(headers), headers=headers)
    server, port = open_rpc()
    metadata = [(name.lower(), value) for name, value in headers.items()]
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        watching: Iterator[Any] = JobServiceStub(channel).WatchJob(
            WatchJobRequest(job_id=job), metadata=metadata
        )
        next(watching)
        began = time.monotonic()
        stop = threading.Thread(target=gateway.client.portal.call, args=(server.stop, 1.0))
        stop.start()
        with pytest.raises(grpc.RpcError) as caught:
            next(watching)
        stop.join()
    assert time.monotonic() - began < _WITHIN_S
    assert outcome_of_error(caught.value).code == "unavailable"
    assert outcome_of_error(caught.value).retry_after
