"""When a simulated autopilot sends its messages: at intervals, in streams, or on request."""

import math
from collections.abc import Callable, Mapping
from typing import Any

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.reports import Reports

_FASTEST_S = 0.1
"""Messages are no more frequent, however fast simulated time is."""
_OFTEN_S, _SELDOM_S, _RARELY_S = 0.2, 1.0, 10.0
_ALWAYS = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: _SELDOM_S, mavlink.MAVLINK_MSG_ID_TIMESYNC: _RARELY_S}
_STREAMS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_WIND,
    ),
}
"""ArduPilot sends these when a ground station has asked for the stream."""
_PX4S = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _OFTEN_S,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _SELDOM_S,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _SELDOM_S,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: _SELDOM_S,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: _SELDOM_S,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _SELDOM_S,
}


class Telemetry:
    """Sends ``reports``, and ``others``: messages of the camera and the gimbal.

    Simulated time and its messages are ``speed_up`` times as fast. ``beat`` is sent every second.
    """

    def __init__(
        self,
        board: Board,
        reports: Reports,
        speed_up: float,
        others: Mapping[int, Callable[[], None]],
        beat: Callable[[], None] | None,
    ) -> None:
        self._board, self._reports, self._speed_up, self._beat = board, reports, speed_up, beat
        self._messages = {**reports.sends, **others}
        wanted = _ALWAYS if board.firmware.is_ardupilot else _ALWAYS | _PX4S
        self._defaults = {each: wanted[each] for each in wanted if each in self._messages}
        self._intervals_s = dict(self._defaults)
        self._next: dict[int, float] = {}
        self._told: tuple[Mode, bool] | None = None

    def send(self, now: float) -> None:
        """Send what is due at ``now``, in real seconds, and a change of the mode at once."""
        beats = now >= self._next.get(mavlink.MAVLINK_MSG_ID_HEARTBEAT, now)
        told = (self._board.state.mode, self._board.state.armed)
        if told != self._told:
            self._told = told
            self._next[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = now
        for message, interval_s in self._intervals_s.items():
            if now >= self._next.get(message, now):
                self._next[message] = now + max(interval_s / self._speed_up, _FASTEST_S)
                self._messages[message]()
        if beats and self._beat is not None:
            self._beat()

    def answer(self, message: int) -> bool:
        """Send a message once; False if there is none of this number."""
        send = self._messages.get(message)
        if send is not None:
            send()
        return send is not None

    def tell_current(self, number: int) -> None:
        """Send the number of the current item."""
        self._reports.current(number)

    def set_interval(self, message: int, interval_us: float) -> bool:
        """Set a message's interval; 0: the default, negative: never. False if there is no such message."""
        if message not in self._messages or not math.isfinite(interval_us):
            return False
        interval_s = self._defaults.get(message, -1.0) if interval_us == 0 else interval_us * 1e-6
        self._set(message, interval_s)
        return True

    def on_stream(self, message: Any) -> None:
        """Start or stop a stream, or all."""
        asked = message.req_stream_id
        rate_hz = message.req_message_rate if message.start_stop else 0
        for stream, names in _STREAMS.items():
            if asked in (mavlink.MAV_DATA_STREAM_ALL, stream):
                for each in names:
                    if each in self._messages:
                        self._set(each, 1.0 / rate_hz if rate_hz > 0 else -1.0)

    def _set(self, message: int, interval_s: float) -> None:
        if interval_s < 0:
            self._intervals_s.pop(message, None)
        else:
            self._intervals_s[message] = interval_s
            self._next.pop(message, None)
