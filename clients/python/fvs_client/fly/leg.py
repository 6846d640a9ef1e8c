"""One leg of a flight: the views of a mission, and which of them was photographed."""

from dataclasses import dataclass, field

from fvs_client import Candidate
from fvs_client.fly.items import PHOTOGRAPHS, Command, MissionItem
from fvs_client.fly.matching import Shot


@dataclass
class Leg:
    """A mission through ``views`` in their order, one photograph at each; a survey has none."""

    items: list[MissionItem]
    views: tuple[Candidate, ...] = ()
    first: int = 1
    """The number of the item at which it begins, after home."""
    shots: list[Shot] = field(init=False)
    """The triggers of its photographs."""

    def __post_init__(self) -> None:
        self.put(self.items, self.first)

    def put(self, items: list[MissionItem], first: int) -> None:
        """Make it part of a longer mission, in which it begins at item ``first``."""
        self.items, self.first = items, first
        triggers = [number for number, item in enumerate(items) if item.command in PHOTOGRAPHS]
        views = [*self.views, *[None] * len(triggers)]
        self.shots = [
            Shot(number, _place_before(items, number), view)
            for number, view in zip(triggers, views, strict=False)
        ]

    @property
    def count(self) -> int:
        """The number of photographs to take."""
        return len(self.shots)

    @property
    def way(self) -> list[tuple[float, float]]:
        """The places that it passes, in degrees."""
        commands = (Command.TAKEOFF, Command.WAYPOINT)
        return [(item.x, item.y) for item in self.items[self.first :] if item.command in commands]

    @property
    def waits_at(self) -> int:
        """The number of the item at which the vehicle waits for its next mission."""
        return next(
            number
            for number, item in enumerate(self.items)
            if number >= self.first and item.command == Command.LOITER_TIME
        )

    @property
    def settled(self) -> bool:
        """Whether each photograph has arrived or failed."""
        return all(shot.arrived or shot.failed for shot in self.shots)

    @property
    def succeeded(self) -> list[Candidate]:
        """The views whose photographs have arrived."""
        return [shot.view for shot in self.shots if shot.view is not None and shot.arrived]

    @property
    def left(self) -> list[Candidate]:
        """The views without a photograph."""
        return [shot.view for shot in self.shots if shot.view is not None and not shot.arrived]

    def reach(self, item: int, now_s: float) -> None:
        """Record that the mission is at ``item``: it may have reached triggers up to the one after it.

        Reports come before the messages that say how far the mission is.
        """
        for shot in self.shots:
            if shot.item <= item + 1:
                shot.reached_s = min(shot.reached_s, now_s)


def _place_before(items: list[MissionItem], number: int) -> MissionItem:
    """The waypoint at which the vehicle is at an item; home is the first."""
    return next(item for item in reversed(items[:number]) if item.command == Command.WAYPOINT)
