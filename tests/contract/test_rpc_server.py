"""The start and the stop of the gRPC server."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import grpc
import pytest
from contract_outcome import outcome_of_error
from fvs.v1.jobs_pb2 import WatchJobRequest
from fvs.v1.jobs_pb2_grpc import JobServiceStub

_WITHIN_S = 10


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
