"""Whether an autopilot has the mission that was sent: read again, and compared item by item.

https://mavlink.io/en/services/mission.html. Autopilots store what they use of an item. These differences are
no faults: frames of items without a position, the integer frames of PX4, parameters that a dialect does not
keep, and altitudes that ArduPilot cuts to centimetres.
"""

import math
from collections.abc import Sequence
from typing import Any

from fvs_client.fly.dialects import Dialect
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import MissionItem, Plan
from fvs_client.fly.link import Link

_INTEGER_FRAMES = {5: 0, 6: 3, 11: 10}
"""``MAV_FRAME_GLOBAL_INT`` and the like mean the same as those without ``INT``."""
_UNITS_1E7 = 1
"""PX4 converts to degrees and back."""
_ALTITUDE_M = 0.01
_FLOAT_32 = 1e-6
"""Relative rounding of 32-bit numbers that were converted, such as degrees to radians and back."""


def require_same(link: Link, items: Sequence[MissionItem], offset: int, dialect: Dialect) -> None:
    """Raise ``VehicleError`` unless the vehicle has these ``items``, and ``NoAnswerError``.

    Errors count items from ``offset``. Home, the first item of missions of some autopilots, is their own.
    """
    count = count_of(link, Plan.MISSION)
    if count != len(items):
        raise _differs(f"it has {count} items instead of {len(items)}")
    for number in range(int(dialect.home_is_first), count):
        what = difference(items[number], item_of(link, Plan.MISSION, number), dialect)
        if what is not None:
            raise _differs(f"item {number + offset} (command {items[number].command}): {what}")
    end(link, Plan.MISSION)


def count_of(link: Link, plan: Plan) -> int | None:
    """The number of items of a ``plan`` on the vehicle; None when it has no such plans."""
    link.forget_answers()
    answer = link.ask(
        lambda: link.send("mission_request_list_send", *link.target, plan),
        ("MISSION_COUNT", "MISSION_ACK"),
        f"request for its {plan.name.lower()}",
        lambda message: bool(message.mission_type == plan),
    )
    return int(answer.count) if answer.get_type() == "MISSION_COUNT" else None


def item_of(link: Link, plan: Plan, number: int) -> Any:
    """One item of the vehicle's ``plan``, a ``MISSION_ITEM_INT``."""
    return link.ask(
        lambda: link.send("mission_request_int_send", *link.target, number, plan),
        ("MISSION_ITEM_INT",),
        f"request for an item of its {plan.name.lower()}",
        lambda message: bool(message.seq == number and message.mission_type == plan),
    )


def end(link: Link, plan: Plan) -> None:
    """Say that all items were received."""
    link.send("mission_ack_send", *link.target, link.mavlink.MAV_MISSION_ACCEPTED, plan)


def difference(sent: MissionItem, got: Any, dialect: Dialect) -> str | None:
    """What differs in a ``MISSION_ITEM_INT`` from the item that was sent; None when it is the same."""
    if got.command != sent.command:
        return f"its command is {got.command}"
    if sent.placed and _INTEGER_FRAMES.get(got.frame, got.frame) != sent.frame:
        return f"its frame is {got.frame} instead of {sent.frame}"
    off = max(abs(one - other) for one, other in zip(sent.encoded, (got.x, got.y), strict=True))
    if off > (_UNITS_1E7 if sent.placed else 0):
        return f"it is at {got.x * 1e-7:.7f}, {got.y * 1e-7:.7f} instead of {sent.x:.7f}, {sent.y:.7f}"
    if sent.placed and abs(got.z - sent.z) > _ALTITUDE_M + _FLOAT_32 * abs(sent.z):
        return f"its altitude is {got.z:g} m instead of {sent.z:g}"
    parameters = (got.param1, got.param2, got.param3, got.param4)
    for number in dialect.keeps.get(sent.command, range(4)):
        turns = number == 3 and sent.placed
        if not _same(sent.parameters[number], parameters[number], turns=turns):
            return (
                f"its parameter {number + 1} is {parameters[number]:g} instead of {sent.parameters[number]:g}"
            )
    return None


def _same(sent: float, got: float, *, turns: bool) -> bool:
    if math.isnan(sent) or math.isnan(got):
        return math.isnan(sent) and math.isnan(got)
    away = (got - sent + 180.0) % 360.0 - 180.0 if turns else got - sent
    return abs(away) <= _FLOAT_32 * max(360.0 if turns else 1.0, abs(sent))


def _differs(what: str) -> VehicleError:
    return VehicleError(
        f"The vehicle has another mission than the one that was sent: {what}.",
        hint="Another program may have changed it: disconnect it. Or the firmware does not do what it means.",
    )
