"""Whether a mission may begin: the vehicle is where it was made for."""

from collections.abc import Sequence

from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import Command, Frame, MissionItem
from fvs_client.fly.places import Home, apart_m
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle
from fvs_client.models.missions import MissionSettings

_MOVED_M = 2.0
_FAR_M = 1_000.0
_HIGH_M = 120.0


class HomeMovedError(VehicleError):
    """Home is not where a mission was made for."""


def require_home(vehicle: Vehicle, home: Home) -> None:
    """Stop the motors and raise ``HomeMovedError`` where arming has moved home.

    Autopilots set it then. Heights of missions are above it.
    """
    now = vehicle.read_home()
    moved_m = home.moved_m(now)
    if moved_m > _MOVED_M:
        vehicle.disarm()
        raise HomeMovedError(
            f"Home has moved by {moved_m:.1f} m since the mission was made.",
            hint="Wait for a better GPS fix.",
        )


def require_near(
    items: Sequence[MissionItem], state: VehicleState, home: Home, limits: MissionSettings
) -> None:
    """Raise ``VehicleError`` for a mission far from the vehicle, or high, unless ``limits`` allow it."""
    places = [item for item in items[1:] if item.command in (Command.TAKEOFF, Command.WAYPOINT)]
    first = next(item for item in places if item.command == Command.WAYPOINT)
    away_m = apart_m((state.latitude_deg, state.longitude_deg), (first.x, first.y))
    if away_m > _FAR_M and "geofence" not in limits:
        raise VehicleError(
            f"The mission begins {away_m:.0f} m from the vehicle.",
            hint=f"More than {_FAR_M:.0f} m need --geofence.",
        )
    highest_m = max(item.z - (home.altitude_m if item.frame == Frame.GLOBAL else 0.0) for item in places)
    if highest_m > _HIGH_M and "highest_height_m" not in limits:
        raise VehicleError(
            f"The mission goes to {highest_m:.0f} m above home.",
            hint=f"More than {_HIGH_M:.0f} m need --highest.",
        )
