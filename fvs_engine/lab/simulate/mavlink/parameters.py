"""Parameters of a simulated autopilot: those that change how it flies, named as its firmware names them.

https://mavlink.io/en/services/parameter.html
"""

import math
import struct
from collections.abc import Callable
from typing import Any

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Firmware, Meaning, Parameter

_NO_INDEX = 65_535
_RANGES = {
    mavlink.MAV_PARAM_TYPE_INT8: (-128, 127),
    mavlink.MAV_PARAM_TYPE_INT16: (-32_768, 32_767),
    mavlink.MAV_PARAM_TYPE_INT32: (-(1 << 31), (1 << 31) - 1),
}


class Parameters:
    """Answers ground stations by ``emit``. PX4 sends the bits of whole numbers, ArduPilot their value."""

    def __init__(self, firmware: Firmware, emit: Callable[..., None]) -> None:
        self._emit, self._meanings = emit, firmware.meanings
        self._bits = not firmware.is_ardupilot
        self._kinds = {kind.name: kind for kind in firmware.parameters}
        self._values = {name: kind.value for name, kind in self._kinds.items()}

    def of(self, meaning: Meaning) -> float:
        """What a parameter is, in m, m/s or as a share."""
        return self.named(self._meanings[meaning])

    def named(self, name: str) -> float:
        """The value of a parameter, times its unit; 0 where the firmware has none of this name."""
        kind = self._kinds.get(name)
        return 0.0 if kind is None else self._values[name] * kind.unit

    def set(self, name: str, value: float) -> None:
        """Change one by ourselves, and tell all ground stations."""
        if name in self._values and self._values[name] != value:
            self._values[name] = value
            self._send(name, _NO_INDEX)

    def on_request_list(self, _message: Any) -> None:
        """Send all."""
        for index, name in enumerate(self._values):
            self._send(name, index)

    def on_request_read(self, message: Any) -> None:
        """Send one, by its index or, where that is negative, by its name."""
        names = list(self._values)
        if 0 <= message.param_index < len(names):
            self._send(names[message.param_index], message.param_index)
        elif message.param_index < 0 and message.param_id in self._values:
            self._send(message.param_id, _NO_INDEX)

    def on_set(self, message: Any) -> None:
        """Change one, and send what it is now; values that are no numbers are ignored."""
        kind = self._kinds.get(message.param_id)
        if kind is None:
            return
        value = self._decoded(kind, message.param_value)
        if not kind.fixed and math.isfinite(value):
            self._values[kind.name] = value
        self._send(kind.name, _NO_INDEX)

    def _decoded(self, kind: Parameter, value: float) -> float:
        limits = _RANGES.get(kind.kind)
        if limits is None or not math.isfinite(value):
            return value
        if self._bits:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return float(min(max(round(value), limits[0]), limits[1]))

    def _send(self, name: str, index: int) -> None:
        kind, value = self._kinds[name].kind, self._values[name]
        if self._bits and kind in _RANGES:
            value = struct.unpack("<f", struct.pack("<i", round(value)))[0]
        self._emit("param_value", name.encode(), value, kind, len(self._values), index)
