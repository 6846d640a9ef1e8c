"""Binds the methods of servicers to those of ``fvs.v1``, by name.

A servicer's method gets the caller and the parsed request and returns a model, a message or None:

* a plain method runs in a thread, with the parsing and the serialising;
* a coroutine runs on the event loop, and gets the ``Call`` too;
* an asynchronous generator answers a stream, and gets the ``Call`` too;
* a coroutine for a stream of requests gets the ``Call``, and in place of the request a function that returns
  the bytes of the next one, None after the last.
"""

import inspect
import re
from collections.abc import Awaitable, Callable
from contextlib import aclosing
from typing import Any, Protocol, TypeVar

import grpc
from anyio.to_thread import run_sync
from google.protobuf.descriptor import MethodDescriptor, ServiceDescriptor
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

from fvs_schema.base import Model
from fvs_schema.rankings import Ranking
from fvs_service.errors import PayloadTooLargeError
from fvs_service.gateway.rpc.calls import Call, Context, Gateway, answer, parsed
from fvs_service.gateway.rpc.conversion import write
from fvs_service.principal import Principal

T = TypeVar("T")

_WITH_LISTS = frozenset(
    {
        "CheckImages",
        "CreateMission",
        "ForecastViews",
        "PlanViews",
        "RankViews",
        "SetControlPoints",
        "SetMask",
        "SetSubtitles",
        "StreamRankViews",
    }
)
"""Methods whose requests have a list or a file."""
_WITHOUT_LISTS_BYTES = 65_536
"""Maximum size of the requests of all other methods."""
_SMALL_BYTES = 4_096
"""Smaller requests are parsed on the event loop: a thread would cost more."""


class Servicer(Protocol):
    """The methods of a service, in snake case."""

    service: ServiceDescriptor


def handlers_of(gateway: Gateway, servicer: Servicer) -> grpc.GenericRpcHandler:
    """The handlers of a service."""
    methods = {
        method.name: _handler(gateway, method, getattr(servicer, snake(method.name)))
        for method in servicer.service.methods
    }
    return grpc.method_handlers_generic_handler(servicer.service.full_name, methods)


def snake(name: str) -> str:
    """``GetSceneSize`` as ``get_scene_size``."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def has_body(method: MethodDescriptor) -> bool:
    """Whether requests carry a model, a file or a stream, and not only ids and numbers: over REST, a body."""
    return method.client_streaming or any(
        field.message_type or field.type == field.TYPE_BYTES for field in method.input_type.fields
    )


class _Operation:
    """One method of a service, and the servicer's function for it."""

    def __init__(self, gateway: Gateway, method: MethodDescriptor, function: Callable[..., Any]) -> None:
        self._gateway, self._function = gateway, function
        self._name = f"/{method.containing_service.full_name}/{method.name}"
        self._request_kind, self._result_kind = (
            GetMessageClass(method.input_type),
            GetMessageClass(method.output_type),
        )
        json_bytes = gateway.application.storage.settings.limits.json_bytes
        self._with_body = has_body(method)
        self._with_list = method.name in _WITH_LISTS
        self._most_bytes = json_bytes if self._with_list else min(json_bytes, _WITHOUT_LISTS_BYTES)

    async def in_thread(self, _: object, context: Context) -> bytes:
        """Answer a unary call with a synchronous method, which runs in a thread."""

        async def work(call: Call, caller: Principal) -> bytes:
            content = await self._content(call, caller)
            return await call.run(
                len(content), lambda: self._serialised(self._function(caller, self._parsed(call, content)))
            )

        return await self._answer(context, work)

    async def on_loop(self, _: object, context: Context) -> bytes:
        """Answer a unary call with a coroutine method."""

        async def work(call: Call, caller: Principal) -> bytes:
            request = await self._request(call, caller)
            result = await self._function(call, caller, request)
            if isinstance(result, Ranking) and result.is_small:
                return self._serialised(result)
            return await run_sync(self._serialised, result)

        return await self._answer(context, work)

    async def to_stream(self, _: object, context: Context) -> None:
        """Answer a call that streams its response."""

        async def work(call: Call, caller: Principal) -> None:
            request = await self._request(call, caller)
            async with aclosing(self._function(call, caller, request)) as results:
                async for result in results:
                    await call.write(await run_sync(self._serialised, result))

        await self._answer(context, work)

    async def from_stream(self, _: object, context: Context) -> bytes:
        """Answer a call that streams its request."""

        async def receive() -> bytes | None:
            content = await context.read()
            return None if content is grpc.aio.EOF else content

        async def work(call: Call, caller: Principal) -> bytes:
            result = await self._function(call, caller, receive)
            return await run_sync(self._serialised, result)

        return await self._answer(context, work)

    async def _answer(self, context: Context, work: Callable[[Call, Principal], Awaitable[T]]) -> T:
        """The result of ``work`` for a caller who is known, and has a slot, before a message is read."""

        async def with_caller(call: Call) -> T:
            caller = await call.caller(with_body=self._with_body)
            with self._gateway.call_limit.slot(caller.tenant_id):
                try:
                    return await work(call, caller)
                finally:
                    call.end_turn()

        return await answer(self._gateway, context, self._name, with_caller)

    async def _content(self, call: Call, caller: Principal) -> bytes:
        """The call's only message."""
        content = await (call.read_list(caller.tenant_id) if self._with_list else call.read())
        if len(content) > self._most_bytes:
            raise PayloadTooLargeError(
                f"The request has more than {self._most_bytes} bytes.", hint="Split it into several calls."
            )
        return content

    async def _request(self, call: Call, caller: Principal) -> Message:
        content = await self._content(call, caller)
        if len(content) <= _SMALL_BYTES:
            return self._parsed(call, content)
        return await call.run(len(content), lambda: self._parsed(call, content))

    def _parsed(self, call: Call, content: bytes) -> Message:
        message = parsed(self._request_kind, content)
        call.name(message)
        return message

    def _serialised(self, result: Model | Message | None) -> bytes:
        if result is None:
            return b""  # google.protobuf.Empty
        message = write(result, self._result_kind) if isinstance(result, Model) else result
        content: bytes = message.SerializeToString()
        return content


def _handler(
    gateway: Gateway, method: MethodDescriptor, function: Callable[..., Any]
) -> grpc.RpcMethodHandler:
    """All requests are streams to gRPC, which reads the only message of others before it calls a handler."""
    operation = _Operation(gateway, method, function)
    if method.client_streaming:
        return grpc.stream_unary_rpc_method_handler(operation.from_stream)
    if method.server_streaming:
        return grpc.stream_stream_rpc_method_handler(operation.to_stream)
    of_loop = inspect.iscoroutinefunction(function)
    return grpc.stream_unary_rpc_method_handler(operation.on_loop if of_loop else operation.in_thread)
