# Generated from _async/rpc.py by `make generate`. Do not edit.
"""A transport that sends the requests of REST as calls of ``fvs.v1``, and makes responses of the answers.

Everything above it is the same over both: resources, retries, errors, resumed downloads, waiting.
"""

import json
import threading
from collections.abc import Iterator
from typing import Any

import grpc
import httpx2
from grpc_health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse

from fvs_client._sync.channels import Channel, Reader, open_channel
from fvs_client.connection import Connection
from fvs_client.requests import EVENT_STREAM, REQUEST_ID, FileBody
from fvs_client.rpc import contract
from fvs_client.rpc.documents import document_of, fill
from fvs_client.rpc.failures import invalid, response_for
from fvs_client.rpc.routes import HEALTH, Route, route_of

_CHUNK_BYTES = 1 << 18
_SLOWEST_BYTES_PER_S = 10_000
"""Minimum speed of an upload, from which its deadline follows."""
_DOWNLOAD_S = 600.0
"""Deadline of one download call; a longer download resumes with another call."""
_HEARTBEAT_S = 15.0
"""Interval at which a quiet event stream wakes its reader; gRPC itself notices a dead connection."""
_EVENT_NUMBER = "event-number"
_UNAVAILABLE = {"code": "unavailable", "detail": "The service is not ready.", "retryable": True}


class RpcTransport(httpx2.BaseTransport):
    """Sends requests over one channel."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._channel: Channel | None = None
        self._opening = threading.Lock()
        self._broken: set[str] = set()
        """Paths of uploads that broke off; the service may have a part of them."""

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        """The service's answer; raises ``httpx2.TransportError``."""
        try:
            return self._answer(request)
        except grpc.RpcError as error:
            return response_for(error, request)
        except ValueError as error:
            return invalid(str(error))

    def close(self) -> None:
        """Close the connections."""
        if self._channel is not None:
            self._channel.close()

    def _answer(self, request: httpx2.Request) -> httpx2.Response:
        if (request.method, request.url.path) == HEALTH:
            return self._health(request)
        route = route_of(request)
        if route.method.client_streaming:
            return self._upload(route, request)
        request.read()
        if not route.method.server_streaming:
            answer = self._fetch(route, route.message(request), request)
            return _BYTES.get(route.method.output_type.name, _document)(answer)
        if route.name == "WatchEvents":
            return self._watch(route, request)
        if route.name == "StreamRankViews":
            return self._rank(route, request)
        return self._download(route, request)

    def _fetch(self, route: Route, message: Any, request: httpx2.Request) -> Any:
        """The message that answers a message."""
        call = self._open().unary_unary(route.path)
        content = call(message.SerializeToString(), timeout=_timeout_s(request), metadata=_metadata(request))
        kind = route.method.output_type
        return content if not kind.fields else contract.message(kind.name).FromString(content)

    def _health(self, request: httpx2.Request) -> httpx2.Response:
        call = self._open().unary_unary("/grpc.health.v1.Health/Check")
        asked = HealthCheckRequest().SerializeToString()
        answer = HealthCheckResponse.FromString(call(asked, timeout=_timeout_s(request)))
        if answer.status == HealthCheckResponse.SERVING:
            return httpx2.Response(200, json={"status": "ok"})
        return httpx2.Response(503, json={"status": 503, **_UNAVAILABLE})

    def _upload(self, route: Route, request: httpx2.Request) -> httpx2.Response:
        """Send an image; the rest of it where an upload of this client broke off."""
        path = request.url.path
        size = int(request.headers["Content-Length"])
        offset = self._offset(route, request, size) if path in self._broken else 0
        first = contract.message("UploadImageRequest")()
        first.upload.size_bytes, first.upload.offset_bytes = size, offset
        fill(first.upload, dict(route.variables))
        fill(first.upload.metadata, dict(request.url.params))
        errors: list[Exception] = []
        messages = _messages(first, request, offset, errors)
        deadline = _timeout_s(request) + size / _SLOWEST_BYTES_PER_S
        call = self._open().stream_unary(route.path)
        try:
            content = call(messages, timeout=deadline, metadata=_metadata(request))
        except grpc.RpcError:
            self._broken.add(path)
            if errors:
                raise errors[0] from None
            raise
        if errors:
            raise errors[0]
        self._broken.discard(path)
        return _document(contract.message("UploadImageResponse").FromString(content).image)

    def _offset(self, route: Route, request: httpx2.Request, size: int) -> int:
        """How many bytes the service has of an upload of ``size`` bytes that broke off."""
        asked = contract.message("GetUploadRequest")()
        fill(asked, dict(route.variables))
        try:
            found = self._fetch(
                Route(contract.method("ImageService", "GetUpload"), route.variables), asked, request
            )
        except grpc.RpcError as error:
            if error.code() is grpc.StatusCode.NOT_FOUND:
                return 0
            raise
        return int(found.offset_bytes) if found.size_bytes == size else 0

    def _download(self, route: Route, request: httpx2.Request) -> httpx2.Response:
        """Bytes from the start that the request names if they are still the same, else all."""
        asked: Any = route.message(request)
        while True:
            call = self._open().unary_stream(route.path)(
                asked.SerializeToString(), timeout=_DOWNLOAD_S, metadata=_metadata(request)
            )
            parts = iter(call)
            info = contract.message("DownloadPart").FromString(next(parts)).info
            tag = f'"{info.sha256}"'
            if asked.start == 0 or request.headers.get("If-Range", tag) == tag:
                break
            call.cancel()
            asked.start = 0
        headers = {"Content-Type": info.media_type, "ETag": tag}
        if asked.start:
            headers["Content-Range"] = f"bytes {info.start}-{info.stop - 1}/{info.size_bytes}"
        stream = _Stream(_chunks(parts), call, request)
        return httpx2.Response(206 if asked.start else 200, headers=headers, stream=stream)

    def _watch(self, route: Route, request: httpx2.Request) -> httpx2.Response:
        """Events as server-sent events, for as long as the client reads them."""
        call = self._open().unary_stream(route.path)(
            route.message(request).SerializeToString(), metadata=_metadata(request)
        )
        begun = dict(call.initial_metadata() or ())
        if _EVENT_NUMBER not in begun:
            for _ in call:  # raises why
                break
            raise httpx2.RemoteProtocolError("The stream has no event number.", request=request)
        reader = Reader(call)
        stream = _Stream(_events(reader, int(begun[_EVENT_NUMBER])), reader, request)
        return httpx2.Response(200, headers={"Content-Type": EVENT_STREAM}, stream=stream)

    def _rank(self, route: Route, request: httpx2.Request) -> httpx2.Response:
        """The parts of a ranking as server-sent events."""
        asked = route.message(request).SerializeToString()
        call = self._open().unary_stream(route.path)(
            asked, timeout=_timeout_s(request), metadata=_metadata(request)
        )
        parts = iter(call)
        first = next(parts)  # raises why there is none
        stream = _Stream(_ranking_parts(first, parts, request), call, request)
        return httpx2.Response(200, headers={"Content-Type": EVENT_STREAM}, stream=stream)

    def _open(self) -> Channel:
        with self._opening:
            if self._channel is None:  # only now, as a channel belongs to the event loop that opens it
                self._channel = open_channel(self._connection)
            return self._channel


class _Stream(httpx2.SyncByteStream):
    """The content of a response, whose call ends with it."""

    def __init__(self, content: Iterator[bytes], call: Any, request: httpx2.Request) -> None:
        self._content, self._call, self._request = content, call, request

    def __iter__(self) -> Iterator[bytes]:
        try:
            for chunk in self._content:
                yield chunk
        except grpc.RpcError as error:
            why = response_for(error, self._request)  # raises when the connection broke
            raise httpx2.ReadError(f"status {why.status_code}", request=self._request) from error

    def close(self) -> None:
        """End the call."""
        self._call.cancel()


def _messages(first: Any, request: httpx2.Request, offset: int, errors: list[Exception]) -> Iterator[bytes]:
    """The messages of an upload; an error of reading the file ends them and goes into ``errors``."""
    yield first.SerializeToString()
    body = request.extensions.get("body")
    if isinstance(body, FileBody):
        body.offset_bytes, offset = offset, 0
    message = contract.message("UploadImageRequest")
    content: Any = request.stream
    try:
        for block in content:
            for start in range(offset, len(block), _CHUNK_BYTES):
                yield message(chunk=block[start : start + _CHUNK_BYTES]).SerializeToString()
    except Exception as error:
        errors.append(error)


def _events(reader: Reader, after: int) -> Iterator[bytes]:
    """Server-sent events after number ``after``, with comments as heartbeats."""
    yield f"id: {after}\n\n".encode()
    while (content := reader.read(_HEARTBEAT_S)) != b"":
        if content is None:
            yield b": heartbeat\n\n"
        else:
            event = contract.message("Event").FromString(content)
            yield f"id: {event.number}\ndata: {json.dumps(document_of(event))}\n\n".encode()


def _ranking_parts(first: bytes, rest: Iterator[bytes], request: httpx2.Request) -> Iterator[bytes]:
    """Server-sent events; an error that ends them is one, too."""
    kind = contract.message("RankingPart")
    yield f"data: {json.dumps(document_of(kind.FromString(first)))}\n\n".encode()
    try:
        for content in rest:
            yield f"data: {json.dumps(document_of(kind.FromString(content)))}\n\n".encode()
    except grpc.RpcError as error:
        problem = response_for(error, request)  # raises when the connection broke
        yield b"event: problem\ndata: " + problem.content + b"\n\n"


def _chunks(parts: Iterator[bytes]) -> Iterator[bytes]:
    for content in parts:
        yield contract.message("DownloadPart").FromString(content).chunk


def _timeout_s(request: httpx2.Request) -> float:
    """How long the client waits for an answer."""
    within = request.headers.get("X-Timeout-S")
    return float(within if within is not None else request.extensions["timeout"]["read"])


def _metadata(request: httpx2.Request) -> tuple[tuple[str, str], ...]:
    names = (REQUEST_ID, "Authorization")
    return tuple((name.lower(), request.headers[name]) for name in names if name in request.headers)


def _document(answer: Any) -> httpx2.Response:
    if isinstance(answer, bytes):  # google.protobuf.Empty
        return httpx2.Response(204)
    return httpx2.Response(200, json=document_of(answer))


def _png(answer: Any) -> httpx2.Response:
    return httpx2.Response(200, headers={"Content-Type": "image/png"}, content=answer.png)


def _file(answer: Any) -> httpx2.Response:
    headers = {
        "Content-Type": answer.media_type,
        "Content-Disposition": f'attachment; filename="{answer.name}"',
    }
    if answer.left_out:
        headers["Left-Out"] = ",".join(answer.left_out)
        headers["Left-Out-Reasons"] = json.dumps(list(answer.reasons))
    return httpx2.Response(200, headers=headers, content=answer.content)


_BYTES = {"CandidateRender": _png, "MissionFile": _file}
"""What makes a response of an answer that is no document, by the message's name."""
