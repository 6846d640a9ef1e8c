"""Runs operations for ``AsyncClient``: what blocks goes to a thread."""

from collections.abc import AsyncIterator
from typing import Any, TypeVar, cast

import anyio
import anyio.to_thread
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


class _Stream:
    """The content of a reply, as it comes."""

    def __init__(self, response: httpx2.Response) -> None:
        self.response = response
        self.chunks = response.aiter_raw()


class AsyncSession:
    """A connection pool and its manners."""

    def __init__(
        self, connection: Connection, retries: Retries, transport: httpx2.AsyncBaseTransport | None
    ) -> None:
        self.retries = retries
        self._connection = connection
        self._http = httpx2.AsyncClient(transport=transport, **connection.options)

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def fetch(self, kind: type[M], request: Request) -> M:
        """Send a request and read its answer."""
        return parse(kind, (await self.run(exchange(request, self.retries))).content, self)

    def every(self, kind: type[M], path: str, limit: int | None = None) -> AsyncIterator[M]:
        """The items of a list; pages are asked for as they are needed."""
        return cast(AsyncIterator[M], self.iterate(every(kind, path, limit, self.retries, self)))

    async def run(self, operation: Operation[T]) -> T:
        """Run an operation to its end."""
        async with _Run(self, operation) as run:
            effect = run.begin()
            while not run.ended:
                effect = await run.perform(effect)
        return cast(T, run.result)

    async def iterate(self, operation: Operation[None]) -> AsyncIterator[Any]:
        """What an operation emits."""
        async with _Run(self, operation) as run:
            effect = run.begin()
            while not run.ended:
                if isinstance(effect, Emit):
                    yield effect.value
                    effect = run.step(None)
                else:
                    effect = await run.perform(effect)

    async def send(self, request: Request) -> Reply:
        """Send a request once."""
        response = await self._send(request, stream=False)
        return Reply(response.status_code, dict(response.headers), response.content)

    async def open(self, request: Request) -> OpenReply:
        """Send a request and read the head of its reply."""
        response = await self._send(request, stream=True)
        return OpenReply(response.status_code, dict(response.headers), _Stream(response))

    async def read(self, stream: _Stream) -> bytes | None:
        """The next bytes of a stream."""
        try:
            return await anext(stream.chunks, None)
        except httpx2.HTTPError as error:
            raise self._connection.failure(error) from error

    async def together(self, effect: Together[T]) -> list[T]:
        """Run operations as tasks."""
        operations = list(effect.operations)
        results: list[Any] = [None] * len(operations)
        failed: list[Exception] = []
        places = anyio.Semaphore(max(1, effect.at_once))

        async def run(index: int, operation: Operation[T]) -> None:
            async with places:
                try:
                    results[index] = await self.run(operation)
                except Exception as error:
                    failed.append(error)
                    group.cancel_scope.cancel()

        async with anyio.create_task_group() as group:
            for index, operation in enumerate(operations):
                group.start_soon(run, index, operation)
        if failed:
            raise failed[0]
        return results

    async def _send(self, request: Request, *, stream: bool) -> httpx2.Response:
        options = self._connection.request_options(request)
        if isinstance(request.body, FileBody):
            options["content"] = _chunks(request.body)
            options["headers"]["Content-Length"] = str(request.body.size_bytes)
        elif request.body is not None:
            options["content"] = request.body
        try:
            built = self._http.build_request(request.method, request.path, **options)
            return await self._http.send(built, stream=stream)
        except httpx2.HTTPError as error:
            raise self._connection.failure(error) from error


async def _chunks(body: FileBody) -> AsyncIterator[bytes]:
    chunks = body.chunks()
    while (chunk := await anyio.to_thread.run_sync(next, chunks, None)) is not None:
        yield chunk


class _Run(Course):
    """One operation on its way; leaving it closes what the operation opened."""

    def __init__(self, session: AsyncSession, operation: Operation[Any]) -> None:
        super().__init__(operation)
        self._session = session
        self._streams: list[_Stream] = []

    async def __aenter__(self) -> "_Run":
        return self

    async def __aexit__(self, *_: object) -> None:
        self.leave()
        with anyio.CancelScope(shield=True):
            for stream in self._streams:
                await stream.response.aclose()

    async def perform(self, effect: Any) -> Any:
        """Do an effect; the next one, unless the operation has ended."""
        try:
            value = await self._do(effect)
        except Exception as error:
            return self.fail(error)
        return self.step(value)

    async def _do(self, effect: Any) -> Any:
        match effect:
            case Send(request):
                return await self._session.send(request)
            case Open(request):
                reply = await self._session.open(request)
                self._streams.append(reply.stream)
                return reply
            case Read(stream):
                return await self._session.read(stream)
            case Close(stream):
                return await stream.response.aclose()
            case Sleep(seconds):
                return await anyio.sleep(seconds)
            case Call(function):
                return await anyio.to_thread.run_sync(function)
            case Together():
                return await self._session.together(effect)
        raise TypeError(f"{effect!r} is no effect")
