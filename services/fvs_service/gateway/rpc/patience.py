"""Timeouts of requests to health and reflection: gRPC itself waits forever, and its calls are limited."""

import asyncio
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import aclosing
from typing import Any, TypeAlias

import grpc

from fvs_service.gateway.rpc.calls import Context

Handler: TypeAlias = grpc.RpcMethodHandler


class RequestPatience(grpc.aio.ServerInterceptor):  # type: ignore[misc]
    """Ends calls whose request does not arrive within ``within_s``, but those of the services of ``package``.

    Calls with one request are handled as streams of one, which look the same to clients. The services of
    the package read their requests themselves, once they know the caller.
    """

    def __init__(self, within_s: float, package: str) -> None:
        self._within_s, self._package = within_s, package

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[Handler]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> Handler:
        """The handler of a call, which waits for the request no longer than it may."""
        handler: Any = await continuation(handler_call_details)
        if handler is None or handler_call_details.method.startswith(f"/{self._package}."):
            return handler
        if handler.request_streaming:
            return self._as_stream(handler, self._all_of(handler.stream_stream))
        if not handler.response_streaming:
            return grpc.stream_unary_rpc_method_handler(
                self._first_of(handler.unary_unary), handler.request_deserializer, handler.response_serializer
            )
        if inspect.isasyncgenfunction(handler.unary_stream):
            return self._as_stream(handler, self._answers_to_first_of(handler.unary_stream))
        return self._as_stream(handler, self._first_of(handler.unary_stream))

    @staticmethod
    def _as_stream(handler: Any, behaviour: Any) -> Handler:
        return grpc.stream_stream_rpc_method_handler(
            behaviour, handler.request_deserializer, handler.response_serializer
        )

    def _first_of(self, behaviour: Any) -> Any:
        async def patient(_requests: object, context: Context) -> Any:
            return await behaviour(await self._request(context), context)

        return patient

    def _answers_to_first_of(self, behaviour: Any) -> Any:
        async def patient(_requests: object, context: Context) -> AsyncIterator[Any]:
            async with aclosing(behaviour(await self._request(context), context)) as answers:
                async for answer in answers:
                    yield answer

        return patient

    def _all_of(self, behaviour: Any) -> Any:
        async def patient(_requests: object, context: Context) -> AsyncIterator[Any]:
            async with aclosing(behaviour(self._requests(context), context)) as answers:
                async for answer in answers:
                    yield answer

        return patient

    async def _requests(self, context: Context) -> AsyncIterator[Any]:
        while (request := await self._read(context)) is not grpc.aio.EOF:
            yield request

    async def _request(self, context: Context) -> Any:
        request = await self._read(context)
        if request is grpc.aio.EOF:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, "The call has no request.")
        return request

    async def _read(self, context: Context) -> Any:
        try:
            async with asyncio.timeout(self._within_s):
                return await context.read()
        except TimeoutError:
            await context.abort(
                grpc.StatusCode.UNAVAILABLE, f"No request arrived within {self._within_s:g} s."
            )
