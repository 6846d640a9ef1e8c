"""Uploads of missions and fences: https://mavlink.io/en/services/mission.html."""

import math
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import MissionItem, Plan
from fvs_client.fly.link import Link

_REPEATED_S = 0.2
"""A request of an item that was sent less than this ago crossed it on the way, or is a duplicate."""
_REQUESTS = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
_HINTS = {
    "MAV_MISSION_NO_SPACE": "It stores fewer items: fly fewer views in one leg (--leg), or fewer corners.",
    "MAV_MISSION_DENIED": "It takes none now: look at its messages in a ground station.",
    "MAV_MISSION_UNSUPPORTED": "Its firmware does not know the command.",
    "MAV_MISSION_UNSUPPORTED_FRAME": "Its firmware does not know altitudes of this kind.",
}
_OTHER_HINT = "The position may be outside of the vehicle's own fence, or a parameter out of its range."


def upload(link: Link, items: Sequence[MissionItem], offset: int, plan: Plan = Plan.MISSION) -> None:
    """Replace the mission, or another ``plan``, of the vehicle on ``link``; errors count from ``offset``.

    The autopilot asks for the items, in any order and as often as it likes. When it falls silent, or takes
    ours for another upload, all is sent once more. An error after the last item may be ArduPilot's answer to
    one that was sent twice, because its acceptance was lost: reading back tells. Raises ``VehicleError`` and
    ``NoAnswerError``.
    """
    accepted = link.mavlink.MAV_MISSION_ACCEPTED
    again = (link.mavlink.MAV_MISSION_ERROR, link.mavlink.MAV_MISSION_OPERATION_CANCELLED)
    try:
        result, asked = _upload(link, items, plan)
    except NoAnswerError:
        result, asked = again[0], -1
    if result in again and not _all_sent(link, result, asked, items):
        result, asked = _upload(link, items, plan)
    if result != accepted and not _all_sent(link, result, asked, items):
        entry = link.mavlink.enums["MAV_MISSION_RESULT"].get(result)
        name = entry.name if entry is not None else str(result)
        item = f", at item {asked + offset} (command {items[asked].command})" if asked >= 0 else ""
        raise VehicleError(
            f"The autopilot refuses the {plan.name.lower()}: {name}{item}.",
            hint=_HINTS.get(name, _OTHER_HINT),
        )


def _all_sent(link: Link, result: int, asked: int, items: Sequence[MissionItem]) -> bool:
    return bool(result == link.mavlink.MAV_MISSION_ERROR and asked == len(items) - 1)


def _upload(link: Link, items: Sequence[MissionItem], plan: Plan) -> tuple[int, int]:
    """Upload once; returns a ``MAV_MISSION_RESULT``, and the number of the item that was requested last."""
    sent_s: dict[int, float] = {}

    def fits(message: Any) -> bool:
        """Whether a message is of this upload: an acceptance before all requests is of another.

        ArduPilot answers an item that came twice with ``INVALID_SEQUENCE``, and goes on.
        """
        if message.mission_type != plan:
            return False
        if message.get_type() == "MISSION_ACK":
            if message.type == link.mavlink.MAV_MISSION_INVALID_SEQUENCE:
                return False
            return bool(message.type != link.mavlink.MAV_MISSION_ACCEPTED or len(sent_s) == len(items))
        return time.monotonic() - sent_s.get(message.seq, -math.inf) > _REPEATED_S

    link.forget_answers()
    last = -1
    name = plan.name.lower()
    answer = link.ask(
        lambda: link.send("mission_count_send", *link.target, len(items), plan), _REQUESTS, name, fits
    )
    while answer.get_type() != "MISSION_ACK":
        last = answer.seq
        if not 0 <= last < len(items):
            raise VehicleError(
                f"The autopilot asks for item {last} of {len(items)}.",
                hint=f"Another program may be uploading a {name}: disconnect it.",
            )
        sent_s[last] = time.monotonic()
        answer = link.ask(partial(_send_item, link, last, items[last], plan), _REQUESTS, name, fits)
    return answer.type, last


def _send_item(link: Link, number: int, item: MissionItem, plan: Plan) -> None:
    x, y = item.encoded
    fields = (number, item.frame, item.command, int(number == 0), 1, *item.parameters, x, y, item.z, plan)
    link.send("mission_item_int_send", *link.target, *fields)
