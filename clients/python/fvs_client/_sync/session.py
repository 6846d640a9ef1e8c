# Generated from _async/session.py by `make generate`. Do not edit.
"""Requests with authentication, retries and typed errors."""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

import httpx2
from pydantic import BaseModel, PrivateAttr

from fvs_client import requests
from fvs_client._sync.concurrency import run_blocking, sleep
from fvs_client.answers import parse, refusal
from fvs_client.connection import Connection
from fvs_client.errors import FvsError, NotFoundError
from fvs_client.request import REQUEST_ID, FileBody, Request
from fvs_client.retries import Retries
from fvs_schema.base import Model, Output

M = TypeVar("M", bound=Model)

_CHUNK_BYTES = 1 << 18


class Session:
    """Sends requests over one connection pool."""

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
        """Send ``request``, with retries, and parse the answer."""
        return parse(kind, self.content(request), self)

    def content(self, request: Request) -> bytes:
        """Send ``request`` as ``response`` does, and return the answer's content."""
        return (self.response(request)).content

    def response(self, request: Request) -> httpx2.Response:
        """Send ``request`` until it succeeds or ``retries`` are used up; the answer has been read."""
        request = request.identified()
        began, attempt = time.monotonic(), 0
        while True:
            attempt += 1
            try:
                with self.open(request) as response:
                    response.read()
                    return response
            except FvsError as error:
                if attempt > 1 and request.method == "DELETE" and isinstance(error, NotFoundError):
                    return httpx2.Response(204)  # an earlier attempt deleted it, and its answer was lost
                pause = self.retries.pause_s(error, attempt, time.monotonic() - began)
                if pause is None or not request.repeatable:
                    raise
            sleep(pause)

    @contextmanager
    def open(self, request: Request) -> Iterator[httpx2.Response]:
        """Send ``request`` once; the content of the response is read inside the block.

        Raises ``FvsError``, also for what breaks while the content is read.
        """
        request = request.identified()
        request_id = request.headers[REQUEST_ID]
        try:
            response = self._http.send(self._build(request), stream=True)
            try:
                if response.is_error:
                    response.read()
                    raise refusal(response, request_id)
                yield response
            finally:
                response.close()
        except httpx2.HTTPError as error:
            raise self._connection.failure(error, request_id) from error

    def items(self, kind: type[M], path: str, params: Mapping[str, Any] | None = None) -> Iterator[M]:
        """The items of a list; pages are requested as they are needed, with ``params`` of their query."""
        page_of: type[_Page[M]] = _Page[kind]  # type: ignore[valid-type]
        after: str | None = None
        while True:
            page = self.fetch(page_of, requests.list_of(path, params or {}, after))
            for item in page.items:
                yield item
            if page.next is None:
                return
            after = page.next

    def _build(self, request: Request) -> httpx2.Request:
        options = self._connection.request_options(request)
        if isinstance(request.body, FileBody):
            options["content"] = _chunks(request.body)
            options["headers"]["Content-Length"] = str(request.body.size_bytes)
        return self._http.build_request(request.method, request.path, **options)


class Resource(Output):
    """Base of answers that can send requests of their own; ``dir`` hides what pydantic adds."""

    _session: Session = PrivateAttr()

    def model_post_init(self, context: Any, /) -> None:
        """Keep the session that fetched the answer."""
        self._session = context["session"]

    def __str__(self) -> str:
        return repr(self)

    def __dir__(self) -> Iterable[str]:
        hidden = {name for name in dir(BaseModel) if name not in dir(object)}
        return sorted({*super().__dir__()} - hidden)


class _Page(Output, Generic[M]):
    """A part of a list; ``next`` is the cursor of the rest."""

    items: tuple[M, ...]
    next: str | None


def _chunks(body: FileBody) -> Iterator[bytes]:
    """The content of a file; raises ``OSError`` when the file no longer has ``size_bytes``."""
    body.restart()
    with run_blocking(body.path.open, "rb") as file:
        while chunk := run_blocking(file.read, _CHUNK_BYTES):
            if body.sent_bytes + len(chunk) > body.size_bytes:
                break
            yield chunk
            body.advance(len(chunk))
    if chunk or body.sent_bytes != body.size_bytes:
        raise OSError(f"{body.path} changed while it was sent.")
