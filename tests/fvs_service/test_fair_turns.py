"""Turns to inspect uploads: whoever sends many does not hold up the others."""

import asyncio
from collections.abc import Sequence

import pytest
from fvs_service.images.fair_turns import FairTurns
from fvs_service.principal import ALL_SCOPES, Principal


def _principal(name: str) -> Principal:
    tenant, _, key = name.partition("/")
    return Principal(tenant, ALL_SCOPES, key_id=key)


async def _order(at_once: int, who: Sequence[str]) -> list[str]:
    """The order in which those who ask in this order, all before the first turn ends, get their turns."""
    turns, served = FairTurns(at_once), list[str]()

    async def ask(name: str) -> None:
        async with turns.turn(_principal(name)):
            served.append(name)
            await asyncio.sleep(0)

    await asyncio.gather(*map(ask, who))
    return served


def test_turns_go_around_between_tenants() -> None:
    served = asyncio.run(_order(1, ["many"] * 5 + ["few"] * 2 + ["one"]))
    assert served == ["many", "few", "one", "many", "few", "many", "many", "many"]


def test_turns_go_around_between_the_keys_of_a_tenant() -> None:
    served = asyncio.run(_order(1, ["a/1"] * 4 + ["a/2", "b/1"]))
    assert served == ["a/1", "b/1", "a/2", "a/1", "a/1", "a/1"]


def test_who_holds_turns_waits_for_who_has_none() -> None:
    async def run() -> list[str]:
        turns, served, long = FairTurns(2), list[str](), asyncio.Event()

        async def ask(name: str) -> None:
            async with turns.turn(_principal(name)):
                served.append(name)
                if name == "long":
                    await long.wait()

        tasks = [asyncio.create_task(ask(name)) for name in ["long", "long", "long", "long", "other"]]
        await asyncio.sleep(0.01)
        assert served == ["long", "long"]
        long.set()
        await asyncio.gather(*tasks)
        return served

    assert asyncio.run(run())[2] == "other"


@pytest.mark.parametrize("when", ["waiting", "chosen", "running"])
def test_a_request_that_is_cut_gives_its_turn_back(when: str) -> None:
    async def run() -> None:
        turns, done = FairTurns(1), asyncio.Event()

        async def hold() -> None:
            async with turns.turn(_principal("a")):
                await done.wait()

        first, second = asyncio.create_task(hold()), asyncio.create_task(hold())
        await asyncio.sleep(0.01)
        if when == "waiting":
            second.cancel()
        elif when == "running":
            first.cancel()
        else:
            first.cancel()
            await asyncio.sleep(0)  # the turn is the second's now, which does not know yet
            second.cancel()
        await asyncio.sleep(0.01)
        done.set()
        await asyncio.gather(first, second, return_exceptions=True)
        async with asyncio.timeout(5), turns.turn(_principal("b")):
            pass

    asyncio.run(run())


def test_a_turn_can_end_in_the_moment_in_which_the_next_request_is_cut() -> None:
    async def run() -> list[BaseException | None]:
        turns, done = FairTurns(1), asyncio.Event()

        async def hold() -> None:
            async with turns.turn(_principal("a")):
                await done.wait()

        first, second = asyncio.create_task(hold()), asyncio.create_task(hold())
        await asyncio.sleep(0)
        await asyncio.sleep(0)  # the first holds the turn, the second waits for it
        done.set()
        second.cancel()  # takes effect only after the first has ended
        ended = await asyncio.gather(first, second, return_exceptions=True)
        async with asyncio.timeout(5), turns.turn(_principal("b")):
            pass
        return ended

    first, second = asyncio.run(run())
    assert first is None
    assert isinstance(second, asyncio.CancelledError)
