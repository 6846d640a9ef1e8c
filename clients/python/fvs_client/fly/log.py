"""The log of a flight: a line of JSON for each event."""

import contextlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from fvs_client.fly.telemetry import VehicleState


@dataclass
class FlightLog:
    """Writes events to a file, if there is one, and prints them.

    An event has its time ``t_s`` since the beginning, the vehicle's position and battery, and a text, which
    is empty for those that are not given.
    """

    path: Path | None
    say: Callable[[str], None]
    _began: float = field(default_factory=time.monotonic)
    _failed: bool = False

    def event(self, kind: str, text: str, state: VehicleState | None = None, **more: object) -> None:
        """Log an event. If that fails, the flight continues."""
        if text:
            self._say(text)
        if self.path is None:
            return
        document: dict[str, object] = {
            "t_s": round(time.monotonic() - self._began, 3),
            "event": kind,
            "text": text,
        }
        if state is not None and state.located:
            document |= {
                "latitude_deg": state.latitude_deg,
                "longitude_deg": state.longitude_deg,
                "height_m": state.height_m,
                "battery": state.battery,
            }
        document |= more
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({key: _plain(value) for key, value in document.items()}) + "\n")
        except OSError as error:
            if not self._failed:
                self._failed = True
                self._say(
                    f"{self.path} cannot be written: {error.strerror}. The flight continues without its log."
                )

    def _say(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
            self.say(text)


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value
