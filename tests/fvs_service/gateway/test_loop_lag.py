"""The lag of the event loop, observed often while requests are handled and rarely otherwise."""

import asyncio
import time

from fvs_service.gateway.loop_lag import LoopLag
from loop_watchdog import ALLOWED_S, watched_loops


class Lags:
    """A stand-in for a histogram."""

    def __init__(self) -> None:
        self.seen: list[float] = []

    def observe(self, lag_s: float) -> None:
        self.seen.append(lag_s)


async def _watched(lags: Lags, handle: bool) -> None:
    lag = LoopLag(lags)  # type: ignore[arg-type]
    watching = asyncio.create_task(lag.watch())
    await asyncio.sleep(0)
    if handle:
        lag.handling()
        await asyncio.sleep(0.05)
        time.sleep(0.3)
    await asyncio.sleep(0.2)
    watching.cancel()


def test_a_request_that_holds_the_loop_is_seen() -> None:
    lags = Lags()
    asyncio.run(_watched(lags, handle=True))
    assert len(lags.seen) > 1
    assert max(lags.seen) > 0.2


def test_the_watchdog_of_the_tests_sees_what_holds_a_loop() -> None:
    async def hold() -> float:
        watching = asyncio.create_task(LoopLag(Lags()).watch())  # type: ignore[arg-type]
        await asyncio.sleep(0.02)
        until = time.process_time() + 2 * ALLOWED_S
        while time.process_time() < until:
            pass
        await asyncio.sleep(0.02)
        watching.cancel()
        return watchdog.longest_s()

    with watched_loops() as watchdog:
        assert asyncio.run(hold()) > ALLOWED_S
        assert watchdog.longest_s() == 0


def test_an_idle_loop_is_left_alone() -> None:
    lags = Lags()
    asyncio.run(_watched(lags, handle=False))
    assert lags.seen == []
