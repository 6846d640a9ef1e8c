"""Parameters of a simulated autopilot: those that change how it flies, named as its firmware names them.

https://mavlink.io/en/services/parameter.html
"""

from collections.abc import Callable
from typing import Any

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Firmware, Meaning


class Parameters:
    """Answers ground stations by ``emit``; values out of range are rejected, which the answer shows."""

    def __init__(self, firmware: Firmware, emit: Callable[..., None]) -> None:
        self._emit, self._meanings = emit, firmware.parameters
        self._kinds = {kind.name: kind for kind in firmware.parameters.values()}
        self._values = {name: kind.value for name, kind in self._kinds.items()}

    def of(self, meaning: Meaning) -> float:
        """What a parameter is, in m, m/s or as a share."""
        parameter = self._meanings[meaning]
        return self._values[parameter.name] * parameter.unit

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
        kind = self._kinds.get(message.param_id)
        if kind is None:
            return
        if kind.least <= message.param_value <= kind.largest:
            self._values[kind.name] = message.param_value
        self._send(kind.name)

    def _send(self, name: str) -> None:
        index, kind = list(self._values).index(name), mavlink.MAV_PARAM_TYPE_REAL32
        self._emit("param_value_send", name.encode(), self._values[name], kind, len(self._values), index)
