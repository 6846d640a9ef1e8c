"""Parameters of a simulated autopilot: those that change how it flies, as ArduCopter has them.

https://mavlink.io/en/services/parameter.html, https://ardupilot.org/copter/docs/parameters.html
"""

from collections.abc import Callable
from typing import Any

from fvs_engine.simulate.mavlink.dialect import mavlink

_RANGES = {
    "RTL_ALT": (1_500.0, 30.0, 300_000.0),
    "WPNAV_RADIUS": (100.0, 5.0, 1_000.0),
    "WPNAV_SPEED": (500.0, 10.0, 2_000.0),
}
"""Name → value, least and largest value: cm and cm/s."""


class Parameters:
    """Answers ground stations by ``tell``; values out of range are not taken, and the answer shows that."""

    def __init__(self, tell: Callable[..., None]) -> None:
        self._tell = tell
        self._values = {name: value for name, (value, _, _) in _RANGES.items()}

    @property
    def return_height_m(self) -> float:
        """How high above home it returns."""
        return self._values["RTL_ALT"] / 100.0

    @property
    def radius_m(self) -> float:
        """How near to a waypoint it is there."""
        return self._values["WPNAV_RADIUS"] / 100.0

    @property
    def speed_m_s(self) -> float:
        """Between waypoints, until a mission changes it."""
        return self._values["WPNAV_SPEED"] / 100.0

    def on_request_list(self, _message: Any) -> None:
        """Send all."""
        for name in self._values:
            self._send(name)

    def on_request_read(self, message: Any) -> None:
        """Send one, by its index or, where that is negative, by its name."""
        names = list(self._values)
        name = names[message.param_index] if 0 <= message.param_index < len(names) else message.param_id
        if name in self._values:
            self._send(name)

    def on_set(self, message: Any) -> None:
        """Change one, and send what it is now."""
        if message.param_id not in _RANGES:
            return
        _, least, largest = _RANGES[message.param_id]
        if least <= message.param_value <= largest:
            self._values[message.param_id] = message.param_value
        self._send(message.param_id)

    def _send(self, name: str) -> None:
        index, kind = list(self._values).index(name), mavlink.MAV_PARAM_TYPE_REAL32
        self._tell("param_value_send", name.encode(), self._values[name], kind, len(self._values), index)
