"""Attitudes as MAVLink has them: quaternions from north, east and down."""

import math


def level_quaternion(yaw_deg: float, pitch_deg: float) -> tuple[float, float, float, float]:
    """The attitude w, x, y, z of something level: north, east and down from forward, right and down."""
    yaw, pitch = 0.5 * math.radians(yaw_deg), 0.5 * math.radians(pitch_deg)
    return (
        math.cos(pitch) * math.cos(yaw),
        -math.sin(pitch) * math.sin(yaw),
        math.sin(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
    )
