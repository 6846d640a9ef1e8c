"""Timeouts of computed answers: ``X-Timeout-S``, and cancellation when the client hangs up."""

import asyncio
from collections.abc import Awaitable
from typing import Annotated, TypeVar

from fastapi import Depends, Header, Request

from fvs_service.errors import ClientGoneError
from fvs_service.gateway.rest.dependencies import application_of

T = TypeVar("T")


async def _timeout_s(
    request: Request,
    timeout_s: Annotated[
        float | None,
        Header(
            alias="X-Timeout-S",
            gt=0,
            le=86_400,
            allow_inf_nan=False,
            description="How long the client waits for the answer; nothing is computed for longer. "
            "The capabilities have the maximum, which is also the default: `limits.ranking_timeout_s`.",
        ),
    ] = None,
) -> float:
    most = application_of(request).storage.settings.limits.ranking_timeout_s
    return most if timeout_s is None else min(timeout_s, most)


TimeoutS = Annotated[float, Depends(_timeout_s)]


async def while_connected(request: Request, work: Awaitable[T]) -> T:
    """The result of ``work``, which is cancelled when the client hangs up; then raises ``ClientGoneError``.

    The body of the request must have been read.
    """
    working = asyncio.ensure_future(work)
    watching = asyncio.ensure_future(_hung_up(request))
    try:
        await asyncio.wait((working, watching), return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise ClientGoneError("The client hung up before the answer.")
        return working.result()
    finally:
        for task in (working, watching):
            task.cancel()
        await asyncio.gather(working, watching, return_exceptions=True)


async def _hung_up(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
