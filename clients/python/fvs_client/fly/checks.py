"""What a flight needs of a vehicle: camera, gimbal and battery."""

from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.log import FlightLog
from fvs_client.fly.settings import FlightSettings
from fvs_client.fly.vehicle import Equipment, Vehicle

_BATTERY_S = 3.0


def require_equipment(equipment: Equipment, settings: FlightSettings) -> None:
    """Raise ``VehicleError`` for a vehicle without camera or gimbal, where ``settings`` require them."""
    if not settings.equipment:
        return
    for what, found in (("camera", equipment.camera), ("gimbal", equipment.gimbal_deg)):
        if found is None:
            raise VehicleError(
                f"The vehicle reports no {what}.",
                hint=f"Set up its {what} in the autopilot, or start its {what} manager. --unchecked "
                "flies without.",
            )


def require_battery(vehicle: Vehicle, settings: FlightSettings, log: FlightLog) -> None:
    """Raise ``VehicleError`` for a vehicle that does not report its battery, which a reserve needs."""
    if settings.reserve <= 0.0:
        return
    try:
        vehicle.wait(lambda: vehicle.last_state.battery is not None, _BATTERY_S, "reports no battery")
    except NoAnswerError:
        raise
    except VehicleError as error:
        if not settings.equipment:
            text = f"{error.message} It is not sent home at the reserve: only its own failsafe does that."
            log.event("warning", f"Warning: {text}", vehicle.last_state)
            return
        raise VehicleError(
            error.message,
            hint="Set up its battery monitor in the autopilot. --unchecked flies without a reserve "
            "(--reserve), as does --reserve 0.",
        ) from error
