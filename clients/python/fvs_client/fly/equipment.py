"""What a flight needs of a vehicle: camera, gimbal and battery."""

import time
from collections.abc import Callable

from fvs_client.fly.captures import Capture
from fvs_client.fly.connection import Equipment
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.failsafes import Check
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs, is_read
from fvs_client.fly.settings import FlightSettings
from fvs_client.fly.vehicle import Vehicle
from fvs_schema.missions import Autopilot

_BATTERY_S = 3.0
_PHOTOGRAPH_S = 10.0
_POLL_S = 0.1


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


def try_camera(
    vehicle: Vehicle, equipment: Equipment, photographs: Photographs, going_on: Callable[[], object]
) -> Check:
    """Take one photograph on the ground, and say whether its file comes within some seconds.

    ``going_on`` is called meanwhile. Raises what it does, ``NoAnswerError``, and what ended the spool.
    """
    if equipment.camera is None:
        name = "none reports itself"
    else:
        name = equipment.camera or "on a wire, without a name"
    if vehicle.state.armed:
        return Check("camera", f"{name}; not tried, because the vehicle is armed")
    vehicle.captures()  # earlier ones
    try:
        vehicle.photograph()
    except NoAnswerError:
        raise
    except VehicleError as error:
        return Check("camera", f"{name}; refuses to photograph: {error.message}", _camera_setup(vehicle))
    reports: list[Capture] = []
    until = time.monotonic() + _PHOTOGRAPH_S
    while True:
        reports += vehicle.captures()
        file = photographs.tested(named=[report.file for report in reports if report.file])
        if (file is not None and is_read(file)) or time.monotonic() > until:
            break
        going_on()
        if any(not report.succeeded for report in reports):
            return Check("camera", f"{name}; reports that its photograph failed", "its storage and its mode")
        time.sleep(_POLL_S)
    vehicle.recover_captures()  # a report that was lost is not to come in flight
    if file is not None and is_read(file):
        return Check("camera", f"{name}; photographs: {file.path.name}")
    if file is not None:
        found = f"{name}; photographs: {file.path.name}, which the service does not read"
        return Check("camera", found, "JPEG, alone or beside raw files")
    if reports:
        found = f"{name}; reports a photograph, but no file came into {photographs.folder}"
        remedy = "--photographs, or how its files come there; a later one would be taken for the first view's"
        return Check("camera", found, remedy)
    found = f"{name}; does not photograph: no report and no file in {_PHOTOGRAPH_S:.0f} s"
    return Check("camera", found, _camera_setup(vehicle))


def _camera_setup(vehicle: Vehicle) -> str:
    ardupilot = vehicle.dialect.autopilot is Autopilot.ARDUPILOT
    return f"{'CAM1_TYPE' if ardupilot else 'TRIG_MODE'}, its cable and its trigger"
