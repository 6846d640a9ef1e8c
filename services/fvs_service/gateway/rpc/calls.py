"""Common handling of all calls: id, API key, deadline, parsing, errors, a log line, metrics.

Messages arrive as bytes and leave as bytes: nothing is parsed before the caller is known, and neither parsing
nor serialising runs on the event loop.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, TypeAlias, TypeVar

import anyio
import anyio.to_thread
import grpc
import structlog
from google.protobuf.message import Message
from starlette.datastructures import State

from fvs_engine.errors import EngineError
from fvs_schema.error_codes import FieldError
from fvs_service.application import Application
from fvs_service.auth import bearer_key
from fvs_service.concurrency import ConcurrencyLimit, TenantTurns
from fvs_service.engine_errors import from_engine
from fvs_service.errors import (
    ClientGoneError,
    DeadlineError,
    InternalError,
    InvalidRequestError,
    LimitExceededError,
    ServiceError,
    SlowRequestError,
    UnauthenticatedError,
    stopping,
)
from fvs_service.events.feed import EventFeed
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.log_fields import about, cause
from fvs_service.gateway.loop_lag import LoopLag
from fvs_service.gateway.refusals import Refusals
from fvs_service.gateway.request_id import HEADER, request_id_of
from fvs_service.gateway.rpc.conversion import parse
from fvs_service.gateway.rpc.failures import DETAILS, code_of, status_of
from fvs_service.gateway.upload_pace import READ_WITHIN_S
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics
from fvs_service.tracing import Span

T = TypeVar("T")
MessageT = TypeVar("MessageT", bound=Message)

Context: TypeAlias = grpc.aio.ServicerContext

MAX_ID_CHARACTERS = 128
MAX_CALLS = 2_048
"""Maximum number of concurrent calls of all tenants."""
_CALLS_PER_TENANT = 512
"""Maximum number of open calls per tenant, so that the server's total has room for others."""
_LISTS_AT_ONCE = 32
"""Messages with lists of a tenant that are read and parsed at once, which takes several times their bytes.
The others stay with their clients until then."""
_FULL_S = 1
"""Clients try again after this time where all calls are taken."""
_METHOD = "RPC"
"""The method in log lines and metrics, where REST has GET or POST."""
_LARGE_BYTES = 65_536
"""Larger messages are parsed one at a time: parsing holds the interpreter."""

_log = structlog.get_logger()


@dataclass
class Gateway:
    """The parts of the gateway that calls use.

    ``request_within_s``: the time within which a request must arrive; ``running``: the tasks of the calls,
    which a stop cuts.
    """

    application: Application
    feed: EventFeed
    metrics: Metrics
    loop_lag: LoopLag
    parsing: anyio.CapacityLimiter
    refusals: Refusals
    drain: Drain
    request_within_s: float
    call_limit: ConcurrencyLimit = field(default_factory=lambda: ConcurrencyLimit("calls", _CALLS_PER_TENANT))
    lists: TenantTurns = field(default_factory=lambda: TenantTurns(_LISTS_AT_ONCE))
    running: set["asyncio.Task[Any]"] = field(default_factory=set)

    @classmethod
    def of(cls, state: State, request_within_s: float) -> "Gateway":
        """The same parts of the application that its requests over REST use."""
        return cls(
            state.application,
            state.feed,
            state.metrics,
            state.loop_lag,
            state.parsing,
            state.refusals,
            state.drain,
            request_within_s,
        )


class Call:
    """One call that is being answered."""

    def __init__(self, gateway: Gateway, context: Context, metadata: dict[str, str]) -> None:
        self._gateway, self._context, self._metadata = gateway, context, metadata
        self._key: str | None = None
        self._principal: Principal | None = None
        self._about: dict[str, str] = {}
        self._turn: asyncio.Semaphore | None = None

    async def caller(self, *, with_body: bool) -> Principal:
        """The principal of the API key in the metadata; raises ``UnauthenticatedError``.

        Raises ``LimitExceededError`` for a call ``with_body`` whose key is on hold.
        """
        keys = self._gateway.application.storage.keys
        given = self._metadata.get("authorization")
        if given is None:
            return await anyio.to_thread.run_sync(keys.authenticate, None)
        key = self._key = bearer_key(given)
        if key is None:  # a broken credential must not count as none
            raise UnauthenticatedError(
                "The authorization metadata is not a Bearer key.", hint="Send authorization: Bearer fvs_…"
            )
        self._gateway.refusals.check(key, with_body=with_body)
        self._principal = await anyio.to_thread.run_sync(keys.authenticate, key)
        return self._principal

    def failed(self, error: ServiceError) -> None:
        """Count the call if it is refused."""
        if self._key is not None:
            self._gateway.refusals.count(self._key, self._principal, error)

    async def read(self) -> bytes:
        """The only message of the request; raises ``SlowRequestError`` if it does not arrive."""
        within_s = self._gateway.request_within_s
        try:
            async with asyncio.timeout(within_s):
                content: bytes = await self._context.read()
        except TimeoutError as error:
            raise SlowRequestError(
                f"No request arrived within {within_s:g} s.", hint="Send it over a better connection."
            ) from error
        if content is grpc.aio.EOF:
            raise InvalidRequestError("The call has no request.", hint="Send one message.")
        self.require_time()
        return content

    async def read_list(self, tenant_id: str) -> bytes:
        """Wait for a turn, and return the only message of a request with a list. See ``end_turn``."""
        self._turn = await self._gateway.lists.begin(tenant_id)
        content = await self.read()
        if len(content) <= _LARGE_BYTES:
            self.end_turn()
        return content

    def end_turn(self) -> None:
        """Let another message with a list be read. Calling it again has no effect."""
        if self._turn is not None:
            self._turn.release()
            self._turn = None

    async def run(self, size_bytes: int, function: Callable[[], T]) -> T:
        """Run ``function``, which converts a message of ``size_bytes``, in a thread."""
        limiter = self._gateway.parsing if size_bytes > _LARGE_BYTES else None
        return await anyio.to_thread.run_sync(function, limiter=limiter)

    async def begin(self, **metadata: str) -> None:
        """Send the metadata of a stream before its first message."""
        await self._context.send_initial_metadata(
            tuple((name.replace("_", "-"), value) for name, value in metadata.items())
        )

    async def write(self, content: bytes) -> None:
        """Send a message of a stream; a client that does not read is cut off."""
        self._gateway.loop_lag.handling()
        try:
            async with asyncio.timeout(READ_WITHIN_S):
                await self._context.write(content)
        except TimeoutError as error:
            raise ClientGoneError(f"The client has read nothing for {READ_WITHIN_S:g} s.") from error

    def name(self, message: Message) -> None:
        """Remember which resources the request is about, for the log."""
        self._about.update(about({described.name: value for described, value in message.ListFields()}))

    @property
    def about(self) -> Mapping[str, str]:
        """The resources that the request is about, as far as it has arrived."""
        return self._about

    @property
    def gateway(self) -> Gateway:
        """The gateway that answers."""
        return self._gateway

    @property
    def left_s(self) -> float | None:
        """The time until the deadline; None without one."""
        return self._context.time_remaining()  # type: ignore[no-any-return]

    def require_time(self) -> None:
        """Raise ``DeadlineError`` once the deadline has passed."""
        if self.left_s is not None and self.left_s <= 0:
            raise DeadlineError("The deadline had passed before the call arrived.")

    def timeout_s(self) -> float:
        """The time that may be spent on the call, in s."""
        most = self._gateway.application.storage.settings.limits.ranking_timeout_s
        return most if self.left_s is None else min(self.left_s, most)


async def answer(gateway: Gateway, context: Context, name: str, work: Callable[[Call], Awaitable[T]]) -> T:
    """The result of ``work``; any failure ends the call with a status that has the reason."""
    metadata = {key: value for key, value in context.invocation_metadata() or () if isinstance(value, str)}
    request_id = request_id_of(metadata.get(HEADER, ""))
    call = Call(gateway, context, metadata)
    task = asyncio.current_task()
    assert task is not None
    gateway.running.add(task)
    gateway.loop_lag.handling()
    with (
        structlog.contextvars.bound_contextvars(request_id=request_id),
        gateway.application.storage.tracing.span(
            name.removeprefix("/"),
            {"rpc.system.name": "grpc", "rpc.method": name.removeprefix("/"), "fvs.request_id": request_id},
            kind="SERVER",
            parent=metadata.get("traceparent"),
            expected=(Exception,),
        ) as span,
        _counted(gateway, name, span, call.about) as outcome,
    ):
        try:
            if gateway.drain.begun:
                raise stopping()
            if len(gateway.running) > MAX_CALLS:
                raise LimitExceededError(
                    f"The service has {MAX_CALLS} open calls, and no more are allowed at once.",
                    hint="Send it again soon.",
                    retry_after_s=_FULL_S,
                )
            call.require_time()
            with gateway.drain.request():
                return await work(call)
        except asyncio.CancelledError:
            error = _cut(gateway, call)
            outcome.append(error)
            if not gateway.drain.begun:
                raise
        except ServiceError as failure:
            error = failure
        except EngineError as failure:
            error = from_engine(failure, gateway.application.storage.settings.root)
        except Exception as failure:
            _log.error("request failed", path=name, exc_info=failure)
            error = InternalError("The service failed.")
        finally:
            gateway.running.discard(task)
        _forget_frames(error)
        outcome.append(error)
        call.failed(error)
        status = status_of(error, request_id)
        trailers = ((HEADER, request_id), (DETAILS, status.SerializeToString()))
        await context.abort(code_of(error), status.message, trailers)
        raise AssertionError  # abort always raises


def _forget_frames(error: BaseException | None) -> None:
    """Drop the tracebacks of an error and its causes.

    They hold the frames of the call, with its messages, and these hold the error: a cycle, which would stay
    in memory until the next garbage collection.
    """
    while error is not None:
        error.__traceback__ = None
        error = error.__cause__ or error.__context__


def _cut(gateway: Gateway, call: Call) -> ServiceError:
    """Why a call was cancelled."""
    if gateway.drain.begun:
        return stopping()
    if call.left_s is not None and call.left_s <= 0:
        return DeadlineError("The deadline has passed.")
    return ClientGoneError("The client has cancelled the call.")


@contextmanager
def _counted(
    gateway: Gateway, name: str, span: Span, resources: Mapping[str, str]
) -> Iterator[list[ServiceError]]:
    """Log and count a call; its error goes into the list."""
    outcome: list[ServiceError] = []
    started = time.perf_counter()
    try:
        yield outcome
    finally:
        seconds = time.perf_counter() - started
        status = code_of(outcome[-1]).name if outcome else "OK"
        span.add({"rpc.response.status_code": status})
        if outcome and outcome[-1].status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            span.fail(outcome[-1].code)
        gateway.metrics.requests.labels(_METHOD, name, status).inc()
        gateway.metrics.seconds.labels(_METHOD, name).observe(seconds)
        failure = outcome[-1] if outcome else None
        _log.info(
            "request",
            method=_METHOD,
            path=name,
            status=status,
            ms=round(seconds * 1000, 1),
            **resources,
            **cause(0 if failure is None else failure.status, failure),
        )


def parsed(kind: type[MessageT], content: bytes) -> MessageT:
    """The request in ``content``; raises ``InvalidRequestError`` where an id cannot be one."""
    message = parse(kind, content)
    for described, value in message.ListFields():
        if described.name.endswith("_id") and (len(value) > MAX_ID_CHARACTERS or "\0" in value):
            raise InvalidRequestError(
                f"{described.name}: it is not an id.",
                hint="Send an id as the service returned it.",
                errors=[FieldError(described.name, "it is not an id")],
            )
    return message
