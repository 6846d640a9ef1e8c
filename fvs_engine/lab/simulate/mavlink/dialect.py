"""The MAVLink dialect, version 2 of the protocol: messages with large numbers do not exist in version 1."""

import os

os.environ["MAVLINK20"] = "1"  # before the first import of pymavlink

from pymavlink.dialects.v20 import ardupilotmega as mavlink  # `common`, and ArduPilot's own

__all__ = ["mavlink"]
