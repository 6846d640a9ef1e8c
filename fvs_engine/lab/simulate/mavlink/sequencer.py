"""The order in which missions are flown: ArduPilot's, and PX4's.

ArduPilot begins a navigation command together with the first command before it that takes no time; the others
before it follow while it is flown, and what is left when it is done is passed over.
"""

from collections.abc import Callable
from enum import IntEnum

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.mission import NAVIGATION, TYPES, UNREPORTED, Item

_TOLD = frozenset({mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LOITER_TIME})
"""Commands whose end ArduPilot tells in words, and which it begins again when the mission has changed."""
_WATCHED = 3
"""Number of commands whose change it notices."""


class Progress(IntEnum):
    """``MISSION_STATE``."""

    NOT_STARTED = mavlink.MISSION_STATE_NOT_STARTED
    ACTIVE = mavlink.MISSION_STATE_ACTIVE
    COMPLETE = mavlink.MISSION_STATE_COMPLETE


class Sequencer:
    """Flies the items that ``items`` returns: ``begin`` begins one, and ``done`` tells whether it is done."""

    def __init__(
        self,
        board: Board,
        items: Callable[[], list[Item]],
        begin: Callable[[Item], None],
        done: Callable[[Item], bool],
    ) -> None:
        self._board, self._items, self._begin, self._done = board, items, begin, done
        self.progress = Progress.NOT_STARTED
        self.current = 0
        """The number of the item that is flown, or would be."""
        self._reached: int | None = None

    @property
    def count(self) -> int:
        """Number of items, with home where that is one."""
        return len(self._items())

    @property
    def running(self) -> bool:
        """Whether a mission is flown."""
        return self.progress is Progress.ACTIVE

    @property
    def state(self) -> int:
        """``MISSION_STATE``."""
        first = int(self._board.firmware.home_is_first)
        return int(self.progress) if self.count > first else int(mavlink.MISSION_STATE_NO_MISSION)

    def stop(self) -> None:
        """Stay at the current item."""
        if self.running:
            self.progress = Progress.NOT_STARTED

    def _report(self) -> None:
        """Send the last item that was reached since the last report."""
        if self._reached is not None:
            self._board.emit("mission_item_reached", self._reached)
            self._reached = None


class InOrder(Sequencer):
    """PX4: one item after the other."""

    def __init__(
        self,
        board: Board,
        items: Callable[[], list[Item]],
        begin: Callable[[Item], None],
        done: Callable[[Item], bool],
    ) -> None:
        super().__init__(board, items, begin, done)
        self._begun = False

    def resume(self) -> None:
        """Fly on from the current item."""
        self._begun, self.progress = False, Progress.ACTIVE

    def reset(self) -> None:
        """Begin with the first item when it is flown next."""
        self.current, self._begun = 0, False

    def go_to(self, number: int) -> bool:
        """Make another item the current one; False if there is none of this number."""
        if not 0 <= number < len(self._items()):
            return False
        self.current, self._begun = number, False
        self._fly_again()
        return True

    def changed(self, current: int | None) -> None:
        """Begin the new mission where it says so; else at the same number, or the last."""
        last = max(0, len(self._items()) - 1)
        self.current, self._begun = min(self.current if current is None else current, last), False
        self._fly_again()

    def stop(self) -> None:
        """Stay at the current item, also where that was the last."""
        self.progress = Progress.NOT_STARTED

    def update(self) -> None:
        """Fly on."""
        while self.running:
            items = self._items()
            if self.current >= len(items):
                self.current, self.progress = max(0, len(items) - 1), Progress.COMPLETE
                return
            item = items[self.current]
            if not self._begun:
                self._begun = True
                self._begin(item)
            if not self.running or not self._done(item):
                return
            self._reached = self.current
            self._report()
            self.current, self._begun = self.current + 1, False

    def _fly_again(self) -> None:
        """Fly on where the mission was complete: the mode has stayed."""
        if self.progress is Progress.COMPLETE:
            self.progress = Progress.ACTIVE


class Concurrent(Sequencer):
    """ArduPilot: a navigation command, and one other command, at a time."""

    def __init__(
        self,
        board: Board,
        items: Callable[[], list[Item]],
        begin: Callable[[Item], None],
        done: Callable[[Item], bool],
    ) -> None:
        super().__init__(board, items, begin, done)
        self._way: Item | None = None
        """The navigation command, as it was when it was begun: an upload does not change it."""
        self._aside: tuple[int, Item] | None = None
        """The other command and its number."""
        self._after: int | None = None
        """Where commands follow that have not been begun; None: there are none."""
        self._watched: list[Item] = []

    def resume(self) -> None:
        """Fly on from the current item, which is begun again, as is the command beside it."""
        complete = self.progress is Progress.COMPLETE
        self.progress = Progress.ACTIVE
        if complete or not 0 < self.current < len(self._items()):
            self.reset()
            self._advance(1)
        elif self._aside is not None:
            self.go_to(self._aside[0])
        elif self._way is not None:
            self.go_to(self.current)

    def reset(self) -> None:
        """Begin with the first item when it is flown next."""
        self.current, self._way, self._aside, self._after = 0, None, None, None

    def go_to(self, number: int) -> bool:
        """Make another item the current one, at once while a mission is flown; False if there is none."""
        items = self._items()
        if not 0 <= number < len(items) or len(items) <= 1:
            return False
        self._aside = self._after = None
        if self.running:
            self._advance(max(1, number))
            return self.running
        found = self._next(max(1, number))
        if found is None:
            return False
        self.current, self._way, self._aside, self._after = found
        self.progress = Progress.NOT_STARTED
        return True

    def update(self) -> None:
        """Fly on; what has been reached is told once, the last of several."""
        if not self.running:
            return
        if self._way is None:
            self._advance(self.current + 1)
        elif self._done(self._way):
            self._reached = self.current
            if self._way.command in _TOLD:
                self._board.text(f"Reached command #{self.current}")
            self._advance(self.current + 1)
        if self.running:
            self._update_aside()
        self._report()

    def changed(self, _current: int | None) -> None:
        """Begin what is at the current number now, where one of the next three items to fly is another."""
        ahead = self._ahead()
        if ahead == self._watched:
            return
        self._watched = ahead
        if not self.running or self._way is None or self._way.command not in _TOLD:
            return
        if self.current < len(self._items()) and self.go_to(self.current):
            self._board.text("Auto mission changed, restarted command", mavlink.MAV_SEVERITY_CRITICAL)
        else:
            text = "Auto mission changed but failed to restart command"
            self._board.text(text, mavlink.MAV_SEVERITY_CRITICAL)

    def _ahead(self) -> list[Item]:
        """The next navigation commands."""
        return [item for item in self._items()[self.current :] if item.command in NAVIGATION][:_WATCHED]

    def _update_aside(self) -> None:
        if self._aside is None:
            items = self._items()
            if self._after is not None and self._after < len(items):
                item, number = items[self._after], self._after
                self._after = None
                if item.command not in NAVIGATION:
                    self._aside, self._after = (number, item), number + 1
                    self._start(number, item)
        elif self._done(self._aside[1]):
            if self._aside[1].command not in UNREPORTED:
                self._reached = self._aside[0]
            self._aside = None

    def _advance(self, number: int) -> None:
        """Begin the next navigation command from this number on."""
        found = self._next(number)
        if found is None:
            self._way, self._aside, self._after = None, None, None
            self.progress = Progress.COMPLETE
            return
        self.current, self._way, self._aside, self._after = found
        self._watched = self._ahead()
        if self._aside is not None:
            self._start(*self._aside)
        self._start(self.current, found[1])

    def _next(self, number: int) -> tuple[int, Item, tuple[int, Item] | None, int | None] | None:
        """The next navigation command, the first command before it, and where others follow."""
        items, aside = self._items(), None
        for index in range(number, len(items)):
            item = items[index]
            if item.command in NAVIGATION:
                return index, item, aside, None if aside is None else aside[0] + 1
            aside = aside or (index, item)
        return None

    def _start(self, number: int, item: Item) -> None:
        self._board.text(f"Mission: {number} {TYPES[item.command]}")
        self._begin(item)
