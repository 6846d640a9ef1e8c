"""Whether PX4 flies a mission that it has taken: ``FeasibilityChecker.cpp`` of its ``navigator``."""

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.fence import Fence
from fvs_engine.lab.simulate.mavlink.firmware import Meaning
from fvs_engine.lab.simulate.mavlink.mission import PLACED, Item

_ABOVE_RADIUS_M = 1.0


def objection(board: Board, fence: Fence, items: list[Item]) -> str | None:
    """PX4's words for what keeps it from flying a mission; None for one that it flies."""
    if not items:
        return "No valid mission"
    if items[0].command == mavlink.MAV_CMD_NAV_LAND and board.landed:
        return "Mission rejected: starts with landing"
    place = board.place
    for number, item in enumerate(items, start=1):
        if item.command not in PLACED:
            continue
        position = item.position(place.origin, place.home_height_m, board.vehicle.believed)
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            if position[2] - place.home_height_m < board.parameters.of(Meaning.RADIUS) + _ABOVE_RADIUS_M:
                return "Mission rejected: Takeoff altitude too low!"
            if any(each.command in PLACED for each in items[: number - 1]):
                return "Mission rejected: takeoff not first waypoint item"
        if not fence.has(position):
            return f"Geofence violation for waypoint {number}"
    return None
