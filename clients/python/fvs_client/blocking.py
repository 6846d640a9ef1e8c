"""Runs operations for ``Client``: every effect is done before the next is asked for."""

import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from typing import Any, TypeVar, cast

import httpx2
import pydantic

from fvs_client.connection import Connection
from fvs_client.effects import (
    Call,
    Close,
    Course,
    Emit,
    FileBody,
    Open,
    OpenReply,
    Operation,
    Read,
    Reply,
    Request,
    Send,
    Sleep,
    Together,
)
from fvs_client.exchange import exchange, parse
from fvs_client.operations.listing import every
from fvs_client.retries import Retries

T = TypeVar("T")
M = TypeVar("M", bound=pydantic.BaseModel)


class _Stopped(Exception):  # noqa: N818 - not an error: another operation of the same call failed
    """The call that this operation belongs to has failed elsewhere."""


class _Stream:
    """The content of a reply, as it comes."""

    def __init__(self, response: httpx2.Response) -> None:
        self.response = response
        self.chunks = response.iter_raw()


class Session:
    """A connection pool and its manners; safe to be used from several threads."""

    def __init__(
        self, connection: Connection, retries: Retries, transport: httpx2.BaseTransport | None
    ) -> None:
        self.retries = retries
        self._connection = connection
        self._http = httpx2.Client(transport=transport, **connection.options)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def fetch(self, kind: type[M], request: Request) -> M:
        """Send a request and read its answer."""
        return parse(kind, self.run(exchange(request, self.retries)).content, self)

    def every(self, kind: type[M], path: str, limit: int | None = None) -> Iterator[M]:
        """The items of a list; pages are asked for as they are needed."""
        return cast(Iterator[M], self.iterate(every(kind, path, limit, self.retries, self)))

    def run(self, operation: Operation[T]) -> T:
        """Run an operation to its end."""
        return self._run(operation, threading.Event())

    def iterate(self, operation: Operation[None]) -> Iterator[Any]:
        """What an operation emits."""
        with _Run(self, operation, threading.Event()) as run:
            effect = run.begin()
            while not run.ended:
                if isinstance(effect, Emit):
                    yield effect.value
                    effect = run.step(None)
                else:
                    effect = run.perform(effect)

    def _run(self, operation: Operation[T], stop: threading.Event) -> T:
        with _Run(self, operation, stop) as run:
            effect = run.begin()
            while not run.ended:
                effect = run.perform(effect)
        return cast(T, run.result)

    def send(self, request: Request) -> Reply:
        """Send a request once."""
        response = self._send(request, stream=False)
        return Reply(response.status_code, dict(response.headers), response.content)

    def open(self, request: Request) -> OpenReply:
        """Send a request and read the head of its reply."""
        response = self._send(request, stream=True)
        return OpenReply(response.status_code, dict(response.headers), _Stream(response))

    def read(self, stream: _Stream) -> bytes | None:
        """The next bytes of a stream."""
        try:
            return next(stream.chunks, None)
        except httpx2.HTTPError as error:
            raise self._connection.failure(error) from error

    def together(self, effect: Together[T]) -> list[T]:
        """Run operations in threads."""
        operations = list(effect.operations)
        stop = threading.Event()
        if min(len(operations), effect.at_once) <= 1:
            return [self._run(operation, stop) for operation in operations]
        with ThreadPoolExecutor(min(len(operations), effect.at_once), "fvs-client") as pool:
            futures = [pool.submit(self._run, operation, stop) for operation in operations]
            try:
                wait_for(futures, return_when=FIRST_EXCEPTION)
                failed = [error for future in futures if future.done() and (error := future.exception())]
                if failed:
                    raise failed[0]
                return [future.result() for future in futures]
            finally:  # after an error, or Ctrl-C: nothing new begins, and nobody sleeps on
                stop.set()
                pool.shutdown(wait=False, cancel_futures=True)

    def _send(self, request: Request, *, stream: bool) -> httpx2.Response:
        options = self._connection.request_options(request)
        if isinstance(request.body, FileBody):
            options["content"] = request.body.chunks()
            options["headers"]["Content-Length"] = str(request.body.size_bytes)
        elif request.body is not None:
            options["content"] = request.body
        try:
            return self._http.send(
                self._http.build_request(request.method, request.path, **options), stream=stream
            )
        except httpx2.HTTPError as error:
            raise self._connection.failure(error) from error


class _Run(Course):
    """One operation on its way; leaving it closes what the operation opened."""

    def __init__(self, session: Session, operation: Operation[Any], stop: threading.Event) -> None:
        super().__init__(operation)
        self._session, self._stop = session, stop
        self._streams: list[_Stream] = []

    def __enter__(self) -> "_Run":
        return self

    def __exit__(self, *_: object) -> None:
        self.leave()
        for stream in self._streams:
            stream.response.close()

    def perform(self, effect: Any) -> Any:
        """Do an effect; the next one, unless the operation has ended."""
        try:
            value = self._do(effect)
        except Exception as error:
            return self.fail(error)
        return self.step(value)

    def _do(self, effect: Any) -> Any:
        match effect:
            case Send(request):
                return self._session.send(request)
            case Open(request):
                reply = self._session.open(request)
                self._streams.append(reply.stream)
                return reply
            case Read(stream):
                return self._session.read(stream)
            case Close(stream):
                return stream.response.close()
            case Sleep(seconds):
                if self._stop.wait(seconds):
                    raise _Stopped
                return None
            case Call(function):
                return function()
            case Together():
                return self._session.together(effect)
        raise TypeError(f"{effect!r} is no effect")
