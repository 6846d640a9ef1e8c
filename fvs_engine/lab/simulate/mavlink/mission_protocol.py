"""The mission protocol of a simulated autopilot: https://mavlink.io/en/services/mission.html."""

import math
import time
from collections.abc import Callable
from typing import Any

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import FlightState
from fvs_engine.lab.simulate.mavlink.mission import Item, Reception

_AGAIN_S = 0.2
"""Minimum time between two requests of an item: every duplicate would be answered, and so on."""


class MissionProtocol:
    """Receives and returns the mission ``items``; ``replaced`` is called when there are new ones.

    While ``refuses`` is true, all are refused, and always those with commands that are ``unknown``.
    """

    def __init__(
        self,
        state: FlightState,
        emit: Callable[..., None],
        replaced: Callable[[], None],
        refuses: Callable[[], bool],
        unknown: frozenset[int],
    ) -> None:
        self.items: list[Item] = []
        self._state, self._emit, self._replaced, self._refuses = state, emit, replaced, refuses
        self._unknown = unknown
        self._reception: Reception | None = None
        self._requested_s = -math.inf
        self._station = (0, 0)
        """The system and component that sends or reads a mission."""

    def on_count(self, message: Any) -> None:
        """Begin to receive a mission."""
        self._station = _sender(message)
        self._reception = Reception(message.count)
        refusal = mavlink.MAV_MISSION_DENIED if self._refuses() else self._reception.refusal
        if refusal is not None:
            self._refuse(refusal)
        elif message.count == 0:
            self._accept([])
        else:
            self._request(0)

    def on_item_int(self, message: Any) -> None:
        """Receive an item, and request the next one."""
        reception = self._reception
        if reception is None:
            if message.seq == len(self.items) - 1:  # whoever sends it has not heard that all is there
                self._emit("mission_ack_send", *_sender(message), mavlink.MAV_MISSION_ACCEPTED)
            return
        if message.seq != len(reception.items):  # one of an earlier request: ours may be lost
            if time.monotonic() - self._requested_s > _AGAIN_S:
                self._request(len(reception.items))
            return
        item = Item.of(message)
        refusal = mavlink.MAV_MISSION_UNSUPPORTED if item.command in self._unknown else item.refusal
        if refusal is not None:
            self._refuse(refusal)
            return
        reception.items.append(item)
        if reception.whole:
            self._accept(reception.items)
        else:
            self._request(len(reception.items))

    def on_request_list(self, message: Any) -> None:
        """Send the number of items."""
        self._station = _sender(message)
        self._emit("mission_count_send", *self._station, len(self.items))

    def on_request_int(self, message: Any) -> None:
        """Send an item."""
        self._station = _sender(message)
        if not 0 <= message.seq < len(self.items):
            self._emit("mission_ack_send", *self._station, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        item = self.items[message.seq]
        factor = 1e7 if item.frame != mavlink.MAV_FRAME_MISSION else 1.0
        place = (round(item.latitude_deg * factor), round(item.longitude_deg * factor), item.altitude_m)
        current = int(message.seq == self._state.item)
        fields = (message.seq, item.frame, item.command, current, 1, *item.parameters, *place)
        self._emit("mission_item_int_send", *self._station, *fields)

    def on_clear_all(self, message: Any) -> None:
        """Forget the mission."""
        self._station = _sender(message)
        self._accept([])

    def _request(self, number: int) -> None:
        self._requested_s = time.monotonic()
        self._emit("mission_request_int_send", *self._station, number)

    def _refuse(self, result: int) -> None:
        self._reception = None
        self._emit("mission_ack_send", *self._station, result)

    def _accept(self, items: list[Item]) -> None:
        self.items, self._reception = list(items), None
        self._replaced()
        self._emit("mission_ack_send", *self._station, mavlink.MAV_MISSION_ACCEPTED)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()
