"""Checks before takeoff: camera, gimbal, battery, and the failsafe for lost ground stations."""

import contextlib

from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.log import FlightLog
from fvs_client.fly.settings import FlightSettings
from fvs_client.fly.vehicle import Vehicle

_BATTERY_S = 3.0


def require_equipment(vehicle: Vehicle, settings: FlightSettings) -> tuple[float, float] | None:
    """Raise ``VehicleError`` for a vehicle without camera or gimbal.

    Returns the gimbal's lowest and highest pitch; None where ``settings`` do not require one.
    """
    if not settings.equipment:
        return None
    equipment = vehicle.equipment()
    for what, found in (("camera", equipment.camera), ("gimbal", equipment.gimbal_deg)):
        if found is None:
            raise VehicleError(
                f"The vehicle reports no {what}.",
                hint=f"Set up its {what} in the autopilot, or start its {what} manager. --unchecked "
                "flies without.",
            )
    return equipment.gimbal_deg


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


def warn_of_failsafe(vehicle: Vehicle, log: FlightLog) -> None:
    """Warn where the vehicle would stay in the air if the link broke off between two missions."""
    name, value = vehicle.dialect.lost_link, None
    with contextlib.suppress(NoAnswerError):
        value = vehicle.parameter(name)
    if value is None:
        is_what = f"The vehicle does not tell {name}, its failsafe for lost ground stations"
        text = f"{is_what}. Where that is off, and the link breaks off"
    elif value == 0.0:
        text = f"{name} is 0: the failsafe for lost ground stations is off. Where the link breaks off"
    else:
        return
    text += " between two missions or in a pause, the vehicle stays in the air there."
    log.event("warning", f"Warning: {text}", vehicle.last_state, parameter=name)
