"""The mission protocol of a simulated autopilot, for its mission, its fence and its rally points.

https://mavlink.io/en/services/mission.html; PX4's ways are those of ``mavlink_mission.cpp``.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.mission import FENCE, PLACED, RALLY, Item

_TIMES_S, _PX4S_TIMES_S = (1.0, 8.0), (0.25, 5.0)
"""Times after which an item is requested again, and after which an upload is given up."""
MISSION, FENCES, RALLIES = (
    int(mavlink.MAV_MISSION_TYPE_MISSION),
    int(mavlink.MAV_MISSION_TYPE_FENCE),
    int(mavlink.MAV_MISSION_TYPE_RALLY),
)
_MOST_ITEMS = {MISSION: 724, FENCES: 84, RALLIES: 10}
_NAMES = {MISSION: "Mission", FENCES: "Fence", RALLIES: "Rally"}
_ALL = int(mavlink.MAV_MISSION_TYPE_ALL)
_WARNING = int(mavlink.MAV_SEVERITY_WARNING)


@dataclass
class Upload:
    """An upload: the items from ``next`` to ``last`` are still to come from a station."""

    station: tuple[int, int]
    next: int
    last: int
    items: list[Item] = field(default_factory=list)
    current: int | None = None
    """The number of the last item that was marked as the current one."""
    requested_s: float = field(default_factory=time.monotonic)
    received_s: float = field(default_factory=time.monotonic)


class ItemList:
    """A list of items that ground stations upload and download.

    ``changed`` is called when it is another, with the number of the item that was marked as the current one.

    ArduPilot changes its mission while the items arrive; PX4, and fences, when all are there. ``current``
    returns the number of the item that is flown, and ``running`` whether one is.
    """

    def __init__(
        self,
        board: Board,
        kind: int,
        changed: Callable[[int | None], None],
        current: Callable[[], int] = lambda: 0,
        running: Callable[[], bool] = lambda: False,
    ) -> None:
        self.items: list[Item] = []
        self._board, self._kind, self._changed = board, kind, changed
        self._current, self._running = current, running
        self._upload: Upload | None = None
        self._download: tuple[tuple[int, int], int] | None = None
        """The station that PX4 sends its items to, and the number of the next one."""
        self._at_once = board.firmware.is_ardupilot and kind == MISSION

    def on_count(self, message: Any) -> None:
        """Begin to receive all items."""
        station = _sender(message)
        if self._busy(station):
            return
        if self._board.faults.refuses_missions:
            self._answer(station, mavlink.MAV_MISSION_DENIED)
        elif message.count > _MOST_ITEMS[self._kind]:
            self._answer(station, mavlink.MAV_MISSION_NO_SPACE)
            self._board.text(f"Only {_MOST_ITEMS[self._kind]} items are supported", _WARNING)
        else:
            self._upload = Upload(station, 0, message.count - 1)
            if self._at_once and message.count < len(self.items):
                del self.items[message.count :]
                self._changed(None)
            if message.count == 0:
                self._complete(self._upload)
            else:
                self._request(self._upload)

    def on_partial(self, message: Any) -> None:
        """Begin to receive some items in the place of those with the same numbers."""
        station, first, last = _sender(message), message.start_index, message.end_index
        if not self._board.firmware.is_ardupilot or self._busy(station):  # PX4 does not know the message
            return
        if self._upload is not None:
            self._answer(station, mavlink.MAV_MISSION_DENIED)
        elif not 0 <= first <= last <= len(self.items):
            self._board.text("Flight plan update rejected", _WARNING)
            self._answer(station, mavlink.MAV_MISSION_ERROR)
        else:
            self._upload = Upload(station, first, last, list(self.items))
            self._request(self._upload)

    def on_item(self, message: Any) -> None:
        """Receive an item, and request the next one."""
        upload, station = self._upload, _sender(message)
        if upload is None:
            late = not self._board.firmware.is_ardupilot and message.seq == len(self.items) - 1
            # PX4 takes it for one whose sender has not heard that all is there.
            self._answer(station, mavlink.MAV_MISSION_ACCEPTED if late else mavlink.MAV_MISSION_ERROR)
        elif message.seq != upload.next and self._board.firmware.is_ardupilot:
            self._answer(station, mavlink.MAV_MISSION_INVALID_SEQUENCE)
        elif station != upload.station:
            self._turn_away(station, "REJ. MIS ITEM: partner id mismatch")
        elif message.seq == upload.next:  # PX4 ignores others
            if message.current:
                upload.current = message.seq
            self._take(upload, Item.of(message))

    def on_request_list(self, message: Any) -> None:
        """Send the number of items."""
        if self._upload is not None:
            self._turn_away(_sender(message), "Mission download request ignored, already active")
        else:
            self._download = (_sender(message), 0)
            self._board.emit("mission_count", *_sender(message), len(self.items), self._kind)

    def on_request(self, message: Any) -> None:
        """Send an item, in whole numbers where it is asked for so."""
        station = _sender(message)
        if self._upload is not None:
            self._turn_away(station, "WPM: REJ. CMD: Busy")
            return
        if not self._board.firmware.is_ardupilot and not self._is_next(station, message.seq):
            return
        item = self._item(message.seq)
        if item is None:
            if self._board.firmware.is_ardupilot and self._kind == MISSION:
                self._board.emit("mission_count", *station, len(self.items), self._kind)
            self._answer(station, mavlink.MAV_MISSION_ERROR)
            return
        fields = (message.seq, item.frame, item.command, self._marked(message.seq, item), 1, *item.parameters)
        if message.get_type() == "MISSION_REQUEST_INT":
            self._board.emit("mission_item_int", *station, *fields, item.x, item.y, item.z, self._kind)
        else:
            factor = 1e-7 if item.command in PLACED | FENCE | RALLY else 1.0
            place = (item.x * factor, item.y * factor, item.z)
            self._board.emit("mission_item", *station, *fields, *place, self._kind)

    def clear(self, station: tuple[int, int]) -> bool:
        """Forget the items; False while another station uploads or, on ArduPilot, the mission is flown."""
        if self._busy(station):
            return False
        self._upload = None
        if self._at_once and self._running():
            return False
        self.items.clear()
        self._changed(None)
        return True

    def update(self) -> None:
        """Request an item again whose answer is overdue, and end uploads that have stopped."""
        upload, now = self._upload, time.monotonic()
        if upload is None:
            return
        again_s, give_up_s = _TIMES_S if self._board.firmware.is_ardupilot else _PX4S_TIMES_S
        if now - upload.received_s > give_up_s:
            self._upload = None
            if self._board.firmware.is_ardupilot:
                self._board.text(f"{_NAMES[self._kind]} upload timeout", _WARNING)
                self._answer(upload.station, mavlink.MAV_MISSION_OPERATION_CANCELLED)
            else:
                self._board.text("Operation timeout", int(mavlink.MAV_SEVERITY_CRITICAL))
        elif now - upload.requested_s > again_s:
            self._request(upload)

    def _is_next(self, station: tuple[int, int], number: int) -> bool:
        """Whether PX4 sends an item: in order, each again, to who has asked for the list."""
        if self._download is None or self._download[0] != station:
            return False
        following = self._download[1]
        if number not in (following - 1, following):
            self._download = None
            self._answer(station, mavlink.MAV_MISSION_ERROR)
            return False
        self._download = (station, number + 1)
        return True

    def _item(self, number: int) -> Item | None:
        if self._kind == MISSION and self._board.firmware.home_is_first and number == 0:
            home = self._board.place.home()
            x, y = round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7)
            altitude_m = round(home.altitude_m * 100.0) * 0.01
            return Item(mavlink.MAV_CMD_NAV_WAYPOINT, 0, (0.0, 0.0, 0.0, 0.0), x, y, altitude_m)
        return self.items[number] if 0 <= number < len(self.items) else None

    def _marked(self, number: int, item: Item) -> int:
        """The field ``current``, for which ArduPilot compares the wrong numbers."""
        return int((item.command if self._board.firmware.is_ardupilot else number) == self._current())

    def _busy(self, station: tuple[int, int]) -> bool:
        """Deny an upload while another station's is under way, or on PX4 the same station's."""
        ardupilot, upload = self._board.firmware.is_ardupilot, self._upload
        if upload is None or (upload.station == station and (ardupilot or upload.next == 0)):
            return False
        self._answer(station, mavlink.MAV_MISSION_DENIED if ardupilot else mavlink.MAV_MISSION_ERROR)
        return True

    def _turn_away(self, station: tuple[int, int], px4: str) -> None:
        """Deny what cannot be done during an upload: PX4 only says so."""
        if self._board.firmware.is_ardupilot:
            self._answer(station, mavlink.MAV_MISSION_DENIED)
        else:
            self._board.text(px4, int(mavlink.MAV_SEVERITY_CRITICAL))

    def _take(self, upload: Upload, item: Item) -> None:
        refusal = self._refusal(item)
        if refusal is not None:
            self._upload = None
            self._answer(upload.station, refusal)
            return
        if self._board.firmware.is_ardupilot and self._kind == MISSION:
            item = item.kept
        target = self.items if self._at_once else upload.items
        target[upload.next : upload.next + 1] = [item]
        upload.next += 1
        upload.received_s = time.monotonic()
        if self._at_once:
            self._changed(None)
        if upload.next > upload.last:
            self._complete(upload)
        else:
            self._request(upload)

    def _refusal(self, item: Item) -> int | None:
        if self._kind == MISSION:
            unknown = item.command in self._board.firmware.unknown
            return int(mavlink.MAV_MISSION_UNSUPPORTED) if unknown else item.refusal
        known = FENCE if self._kind == FENCES else RALLY
        return None if item.command in known else int(mavlink.MAV_MISSION_UNSUPPORTED)

    def _complete(self, upload: Upload) -> None:
        self._upload = None
        if self._at_once:
            self._board.text("Flight plan received")
        self._answer(upload.station, mavlink.MAV_MISSION_ACCEPTED)
        if not self._at_once and upload.items != self.items:
            self.items = upload.items
            self._changed(upload.current)

    def _request(self, upload: Upload) -> None:
        upload.requested_s = time.monotonic()
        ask = "mission_request" if self._board.firmware.is_ardupilot else "mission_request_int"
        self._board.emit(ask, *upload.station, upload.next, self._kind)

    def _answer(self, station: tuple[int, int], result: int) -> None:
        self._board.emit("mission_ack", *station, result, self._kind)


class MissionProtocol:
    """Passes messages to the list that they are about."""

    def __init__(self, board: Board, lists: dict[int, ItemList]) -> None:
        self._board, self._lists = board, lists

    def handlers(self) -> dict[str, Callable[[Any], None]]:
        """What handles each message."""
        return {
            "MISSION_COUNT": lambda message: self._pass(message, ItemList.on_count),
            "MISSION_ITEM": lambda message: self._pass(message, ItemList.on_item),
            "MISSION_ITEM_INT": lambda message: self._pass(message, ItemList.on_item),
            "MISSION_WRITE_PARTIAL_LIST": lambda message: self._pass(message, ItemList.on_partial),
            "MISSION_REQUEST_LIST": lambda message: self._pass(message, ItemList.on_request_list),
            "MISSION_REQUEST": lambda message: self._pass(message, ItemList.on_request),
            "MISSION_REQUEST_INT": lambda message: self._pass(message, ItemList.on_request),
            "MISSION_CLEAR_ALL": self._clear,
        }

    def update(self) -> None:
        """Repeat what is overdue."""
        for each in self._lists.values():
            each.update()

    def _pass(self, message: Any, to: Callable[[ItemList, Any], None]) -> None:
        found = self._lists.get(message.mission_type)
        if found is None:
            self._answer(message, mavlink.MAV_MISSION_UNSUPPORTED)
        else:
            to(found, message)

    def _clear(self, message: Any) -> None:
        kinds = list(self._lists) if message.mission_type == _ALL else [message.mission_type]
        if any(kind not in self._lists for kind in kinds):
            self._answer(message, mavlink.MAV_MISSION_UNSUPPORTED)
            return
        done = [self._lists[kind].clear(_sender(message)) for kind in kinds]
        self._answer(message, mavlink.MAV_MISSION_ACCEPTED if all(done) else mavlink.MAV_MISSION_ERROR)

    def _answer(self, message: Any, result: int) -> None:
        self._board.emit("mission_ack", *_sender(message), result, message.mission_type)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()
