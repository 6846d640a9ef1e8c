"""Turns to inspect and store uploads, fair between tenants, then between the keys of a tenant.

Decoding an image can take a minute; first come, first served, one tenant's uploads would hold up all others.
Waiting happens on the event loop, so that it holds no thread.
"""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from fvs_service.principal import Principal


@dataclass(eq=False)
class _Waiting:
    tenant_id: str
    key_id: str
    turn: "asyncio.Future[None]"


class FairTurns:
    """Gives ``at_once`` turns at the same time; all calls are made on one event loop.

    The next one goes to the tenant with the fewest, of those to the one that got its last turn the longest
    ago, within the tenant to the key for which the same holds.
    """

    def __init__(self, at_once: int) -> None:
        self._free = at_once
        self._running: Counter[tuple[str, ...]] = Counter()
        self._served: dict[tuple[str, ...], int] = {}
        self._number = 0
        self._waiting: list[_Waiting] = []

    @asynccontextmanager
    async def turn(self, principal: Principal) -> AsyncIterator[None]:
        """Wait for a turn, which lasts until the end of the block."""
        who = _Waiting(principal.tenant_id, principal.key_id, asyncio.get_running_loop().create_future())
        self._waiting.append(who)
        self._give()
        try:
            await who.turn
        except asyncio.CancelledError:
            if who in self._waiting:
                self._waiting.remove(who)
            else:  # it got its turn at the same moment
                self._end(who)
            raise
        try:
            yield
        finally:
            self._end(who)

    def _give(self) -> None:
        while self._free and self._waiting:
            chosen = min(self._waiting, key=self._precedence)
            self._waiting.remove(chosen)
            self._free -= 1
            self._number += 1
            for name in _names(chosen):
                self._running[name] += 1
                self._served[name] = self._number
            if not chosen.turn.done():  # else it is cancelled, does not know yet, and gives the turn back
                chosen.turn.set_result(None)

    def _end(self, who: _Waiting) -> None:
        self._free += 1
        for name in _names(who):
            self._running[name] -= 1
        self._give()
        if not self._waiting:  # nobody whose order it could matter for
            self._served.clear()
            self._running += Counter()  # without those that are 0

    def _precedence(self, who: _Waiting) -> tuple[tuple[int, int], ...]:
        return tuple((self._running[name], self._served.get(name, 0)) for name in _names(who))


def _names(who: _Waiting) -> tuple[tuple[str, ...], ...]:
    return (who.tenant_id,), (who.tenant_id, who.key_id)
