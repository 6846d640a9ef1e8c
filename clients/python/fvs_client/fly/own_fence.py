"""The vehicle's own fence, and whether a geofence is inside it: https://mavlink.io/en/services/mission.html.

ArduPilot and PX4 store a fence as a plan of its own: the corners of polygons, each with their number, and
circles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import Command, Frame, MissionItem, Plan
from fvs_client.fly.link import Link
from fvs_client.fly.read_back import count_of, end, item_of
from fvs_client.fly.upload import upload
from fvs_schema.fence import Fence

_UNITS_1E7 = 1
"""PX4 converts degrees and back."""


@dataclass(frozen=True)
class OwnFence:
    """A fence on a vehicle."""

    polygons: tuple[Fence, ...] = ()
    """Those to stay inside."""
    others: int = 0
    """The number of its circles, and of its polygons to stay outside."""

    def is_same(self, fence: Fence) -> bool:
        """Whether it is this fence and nothing else."""
        return not self.others and len(self.polygons) == 1 and _equal(self.polygons[0], fence)

    def contains(self, fence: Fence) -> bool:
        """Whether a fence is inside all of its polygons."""
        edges = list(pairwise([*fence.corners, fence.corners[0]]))
        return all(
            _equal(own, fence)
            or (all(map(own.has, fence.corners)) and not any(own.crosses(*edge) for edge in edges))
            for own in self.polygons
        )


def read_fence(link: Link) -> OwnFence | None:
    """The fence of the vehicle on ``link``; None when it stores none. Raises ``NoAnswerError``."""
    count = count_of(link, Plan.FENCE)
    if count is None:
        return None
    items = [item_of(link, Plan.FENCE, number) for number in range(count)]
    end(link, Plan.FENCE)
    return _fence_of(items)


def upload_fence(link: Link, fence: Fence) -> None:
    """Replace all of the vehicle's fence by a polygon to stay inside, and read it back.

    Raises ``VehicleError`` when it is refused, or the vehicle has another afterwards, and ``NoAnswerError``.
    """
    count = float(len(fence.corners))
    corner = (Command.FENCE_INSIDE, Frame.GLOBAL, (count, 0.0, 0.0, 0.0))
    upload(link, [MissionItem(*corner, *place) for place in fence.corners], 0, Plan.FENCE)
    own = read_fence(link)
    if own is None or not own.is_same(fence):
        raise VehicleError(
            "The vehicle has another fence than the one that was sent.",
            hint="Another program may have changed it: disconnect it, and look at the fence there.",
        )


def _fence_of(items: Sequence[Any]) -> OwnFence:
    polygons, others, number = [], 0, 0
    while number < len(items):
        first = items[number]
        corners = int(first.param1) if first.command in (Command.FENCE_INSIDE, Command.FENCE_OUTSIDE) else 1
        shape = items[number : number + max(corners, 1)]
        number += len(shape)
        if first.command == Command.FENCE_INSIDE:
            polygons.append(Fence([(one.x * 1e-7, one.y * 1e-7) for one in shape]))
        else:
            others += 1
    return OwnFence(tuple(polygons), others)


def _equal(own: Fence, fence: Fence) -> bool:
    if len(own.corners) != len(fence.corners):
        return False
    return all(
        abs(round(one * 1e7) - round(other * 1e7)) <= _UNITS_1E7
        for both in zip(own.corners, fence.corners, strict=True)
        for one, other in zip(*both, strict=True)
    )
