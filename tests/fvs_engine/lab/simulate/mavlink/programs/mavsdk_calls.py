"""Calls MAVSDK, before version 4 or since, and prints a line of JSON with what came of each call.

Arguments: the URL of the vehicle, and the firmware that it has. Run with a Python that has ``mavsdk``.
"""

import asyncio
import importlib
import json
import math
import socket
import sys
from collections.abc import Awaitable, Callable
from typing import Any

import mavsdk

OLD = not hasattr(mavsdk, "ConnectionResult")
LATITUDE, LONGITUDE = 47.3769, 8.5417
PLUGINS = (
    "action", "camera", "geofence", "gimbal", "info", "mavlink_direct", "mission_raw", "param", "telemetry"
)  # fmt: skip
GUIDED = 4


class Vehicle:
    """The plugins of either version; ``first`` is what a stream yields first."""

    def __init__(self) -> None:
        self.plugins: dict[str, Any] = {}

    async def connect(self, url: str) -> None:
        if OLD:
            with socket.create_server(("127.0.0.1", 0)) as free:
                port = free.getsockname()[1]
            self._system = mavsdk.System(port=port)  # of the server that it starts
            await self._system.connect(system_address=url)
            async for state in self._system.core.connection_state():
                if state.is_connected:
                    break
            self.plugins = {name: getattr(self._system, name) for name in PLUGINS}
            return
        wrapped = importlib.import_module("mavsdk.asyncio")
        kind = wrapped.ComponentType.GROUND_STATION
        self._mavsdk = wrapped.Mavsdk(wrapped.Configuration.create_with_component_type(kind))
        await self._mavsdk.add_any_connection(url)
        system = await self._mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None
        for name in PLUGINS:
            module = importlib.import_module(f"mavsdk.asyncio.plugins.{name}")
            words = "".join(word.capitalize() for word in name.split("_"))
            self.plugins[name] = getattr(module, f"{words}Async")(system)

    def __getattr__(self, name: str) -> Any:
        return self.plugins[name]

    async def first(
        self, plugin: str, stream: str, wanted: Callable[[Any], bool] = lambda _value: True
    ) -> Any:
        name = stream if OLD else f"subscribe_{stream}"
        async for value in getattr(self.plugins[plugin], name)():
            if wanted(value):
                return value
        raise AssertionError(f"{stream} ended")

    def types(self, plugin: str) -> Any:
        return importlib.import_module(f"mavsdk.{plugin}" if OLD else f"mavsdk.plugins.{plugin}")


def word(value: Any) -> str:
    """The name of a value of an enumeration."""
    return str(getattr(value, "name", value))


def items(
    types: Any, commands: list[tuple[int, int, list[float], float, float, float]], kind: int = 0
) -> list[Any]:
    return [
        types.MissionItem(
            number, frame, command, int(number == 0), 1, *parameters, round(x * 1e7), round(y * 1e7), z, kind
        )
        for number, (command, frame, parameters, x, y, z) in enumerate(commands)
    ]


def mission(ardupilot: bool) -> list[tuple[int, int, list[float], float, float, float]]:
    none = [0.0] * 4
    photograph = (2000, 2, [0.0, 0.0, 1.0, 0.0], 0.0, 0.0, 0.0)
    home = [(16, 0, none, LATITUDE, LONGITUDE, 440.0)] if ardupilot else []
    return [
        *home,
        (22, 3, none, LATITUDE, LONGITUDE, 10.0),
        (16, 3, [0.0, 1.0, 0.0, math.nan], LATITUDE + 3e-4, LONGITUDE, 12.0),
        photograph,
        (16, 3, [0.0, 1.0, 0.0, math.nan], LATITUDE + 3e-4, LONGITUDE + 3e-4, 12.0),
        (20, 2, none, 0.0, 0.0, 0.0),
    ]


def _tell(what: dict[str, str]) -> None:
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()


class Calls:
    """Does calls one by one, and prints what comes of them."""

    def __init__(self, vehicle: Vehicle, ardupilot: bool) -> None:
        self.vehicle, self.ardupilot = vehicle, ardupilot

    async def do(self, name: str, call: Callable[[], Awaitable[Any]], seconds: float = 12.0) -> Any:
        try:
            value = await asyncio.wait_for(call(), seconds)
        except Exception as error:
            _tell({"call": name, "error": f"{type(error).__name__}: {error}"[:200]})
            return None
        _tell({"call": name, "value": str(value)[:200]})
        return value

    async def send(self, name: str, **fields: int) -> None:
        """Send a message that MAVSDK has no call for."""
        target = {"target_system": 1, "target_component": 1}
        message = self.vehicle.types("mavlink_direct").MavlinkMessage(
            name, 255, 190, 1, 1, json.dumps(target | fields)
        )
        await self.vehicle.mavlink_direct.send_message(message)

    async def telemetry(self) -> None:
        v = self.vehicle
        if self.ardupilot:  # it sends no streams that nobody asks for
            streams = {"req_stream_id": 0, "req_message_rate": 4, "start_stop": 1}
            await self.do("mavlink_direct (streams)", lambda: self.send("REQUEST_DATA_STREAM", **streams))
            await self.do("telemetry.set_rate_in_air", lambda: v.telemetry.set_rate_in_air(4.0))
            await self.do("telemetry.set_rate_home", lambda: v.telemetry.set_rate_home(1.0))
        for stream in (
            "position", "home", "in_air", "landed_state", "armed", "battery", "gps_info", "flight_mode",
            "heading", "velocity_ned", "attitude_euler", "attitude_quaternion", "raw_gps", "unix_epoch_time",
        ):  # fmt: skip
            await self.do(f"telemetry.{stream}", lambda stream=stream: v.first("telemetry", stream))
        await self.do("telemetry.health", lambda: v.first("telemetry", "health"))
        await self.do("telemetry.health_all_ok", lambda: v.first("telemetry", "health_all_ok", bool), 15.0)
        await self.do("telemetry.set_rate_position", lambda: v.telemetry.set_rate_position(5.0))
        await self.do("telemetry.set_rate_battery", lambda: v.telemetry.set_rate_battery(2.0))
        await self.do("info.get_version", v.info.get_version)

    async def parameters(self) -> None:
        p = self.vehicle.param
        whole, real = (
            ("FS_GCS_ENABLE", "WPNAV_SPEED") if self.ardupilot else ("SYS_AUTOSTART", "MPC_XY_CRUISE")
        )
        value = await self.do("param.get_param_int", lambda: p.get_param_int(whole))
        await self.do("param.set_param_int", lambda: p.set_param_int(whole, value or 0))
        speed = await self.do("param.get_param_float", lambda: p.get_param_float(real))
        await self.do("param.set_param_float", lambda: p.set_param_float(real, speed or 1.0))
        await self.do("param.get_all_params", p.get_all_params, 30.0)

    async def fences(self) -> None:
        v, types = self.vehicle, self.vehicle.types("geofence")
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        points = [types.Point(LATITUDE + x * 1e-3, LONGITUDE + y * 1e-3) for x, y in corners]
        kind = types.FenceType.INCLUSION
        fence = types.GeofenceData([types.Polygon(points, kind)], [types.Circle(points[0], 50.0, kind)][:0])
        await self.do("geofence.upload_geofence", lambda: v.geofence.upload_geofence(fence))
        await self.do("mission_raw.download_geofence", self._four_corners)
        raw = v.types("mission_raw")
        rally = items(raw, [(5100, 3, [0.0] * 4, LATITUDE, LONGITUDE, 20.0)], 2)
        await self.do("mission_raw.upload_rally_points", lambda: v.mission_raw.upload_rally_points(rally))
        await self.do("mission_raw.download_rallypoints", v.mission_raw.download_rallypoints)

    async def _four_corners(self) -> Any:
        found = await self.vehicle.mission_raw.download_geofence()
        assert len(found) == 4, found
        return found

    async def missions(self) -> None:
        v, raw = self.vehicle, self.vehicle.types("mission_raw")
        wanted = items(raw, mission(self.ardupilot))
        await self.do("mission_raw.upload_mission", lambda: v.mission_raw.upload_mission(wanted))
        await self.do("mission_raw.download_mission", lambda: self._same(wanted))
        await self.do("geofence.clear_geofence", v.geofence.clear_geofence)
        await self.do("mission_raw.download_mission (the fence was cleared)", lambda: self._same(wanted))
        await self.do(
            "mission_raw.set_current", lambda: v.mission_raw.set_current_mission_item(int(self.ardupilot))
        )

    async def _same(self, wanted: list[Any]) -> Any:
        got = await self.vehicle.mission_raw.download_mission()
        assert [item.command for item in got] == [item.command for item in wanted], got
        return [item.command for item in got]

    async def flight(self) -> None:
        v = self.vehicle
        await self.do("action.arm", self._arm)
        await self.do("mission_raw.start_mission", v.mission_raw.start_mission)
        await self.do("telemetry.in_air (true)", lambda: v.first("telemetry", "in_air", bool), 30.0)
        await self.do(
            "mission_raw.mission_progress",
            lambda: v.first(
                "mission_raw", "mission_progress", lambda p: p.current >= 1 + int(self.ardupilot)
            ),
            30.0,
        )
        await self.do("mission_raw.pause_mission", v.mission_raw.pause_mission)
        await self.do(
            "telemetry.flight_mode (hold)",
            lambda: v.first("telemetry", "flight_mode", lambda mode: word(mode) in ("HOLD", "UNKNOWN")),
        )
        await self.do("mission_raw.start_mission (again)", v.mission_raw.start_mission)
        await self.do("camera.capture_info (of the mission)", lambda: v.first("camera", "capture_info"), 30.0)
        await self.do("action.hold", v.action.hold)
        await self.do("action.set_current_speed", lambda: v.action.set_current_speed(4.0))
        await self.do(
            "action.goto_location", lambda: v.action.goto_location(LATITUDE + 1e-4, LONGITUDE, 455.0, 0.0)
        )
        await self.do(
            "telemetry.position (there)",
            lambda: v.first("telemetry", "position", lambda p: abs(p.latitude_deg - LATITUDE - 1e-4) < 1e-5),
            40.0,
        )
        await self.do("action.return_to_launch", v.action.return_to_launch)
        await self.do(
            "telemetry.armed (false)", lambda: v.first("telemetry", "armed", lambda armed: not armed), 90.0
        )
        await self.do("mission_raw.clear_mission", v.mission_raw.clear_mission)

    async def takeoff(self) -> None:
        v = self.vehicle
        await self.do("action.set_takeoff_altitude", lambda: v.action.set_takeoff_altitude(8.0))
        await self.do("action.arm (again)", self._arm)
        await self.do("action.takeoff", v.action.takeoff)
        await self.do(
            "telemetry.position (up)",
            lambda: v.first("telemetry", "position", lambda p: p.relative_altitude_m > 1.8),
            40.0,
        )
        await self.do("action.land", v.action.land)
        await self.do(
            "telemetry.landed_state (ground)",
            lambda: v.first("telemetry", "landed_state", lambda state: word(state) == "ON_GROUND"),
            60.0,
        )
        await self.do(
            "telemetry.armed (false again)",
            lambda: v.first("telemetry", "armed", lambda armed: not armed),
            60.0,
        )

    async def _arm(self) -> None:
        """ArduPilot arms in some modes only; MAVSDK's hold is none of them since version 4."""
        if self.ardupilot:
            await self.send("SET_MODE", base_mode=1, custom_mode=GUIDED)
            await asyncio.sleep(0.5)
        await self.vehicle.action.arm()

    async def equipment(self) -> None:
        v = self.vehicle
        number = 100
        await self.do(
            "camera.camera_list",
            lambda: v.first(
                "camera", "camera_list", lambda found: number in [each.component_id for each in found.cameras]
            ),
        )
        await self.do("camera.set_mode", lambda: v.camera.set_mode(number, v.types("camera").Mode.PHOTO))
        taken = asyncio.ensure_future(
            self.do("camera.capture_info", lambda: v.first("camera", "capture_info"))
        )
        await asyncio.sleep(0.5)
        await self.do("camera.take_photo", lambda: v.camera.take_photo(number))
        await taken
        await self.do("camera.storage", lambda: v.first("camera", "storage"), 20.0)
        await self.do("camera.get_storage", lambda: v.camera.get_storage(number))
        every = v.types("camera").PhotosRange
        await self.do("camera.list_photos", lambda: v.camera.list_photos(number, every.ALL))
        gimbals = await self.do(
            "gimbal.gimbal_list",
            lambda: v.first("gimbal", "gimbal_list", lambda found: bool(found.gimbals)),
            40.0,
        )
        which = gimbals.gimbals[0].gimbal_id if gimbals else 1
        types = v.types("gimbal")
        await self.do("gimbal.take_control", lambda: v.gimbal.take_control(which, types.ControlMode.PRIMARY))
        await self.do(
            "gimbal.set_angles",
            lambda: v.gimbal.set_angles(
                which, 0.0, -35.0, 0.0, types.GimbalMode.YAW_FOLLOW, types.SendMode.ONCE
            ),
        )
        await self.do(
            "gimbal.attitude",
            lambda: v.first(
                "gimbal", "attitude", lambda a: abs(a.euler_angle_forward.pitch_deg + 35.0) < 1.0
            ),
        )
        await self.do("gimbal.get_control_status", lambda: v.gimbal.get_control_status(which))
        await self.do("gimbal.release_control", lambda: v.gimbal.release_control(which))


async def main(url: str, firmware: str) -> None:
    vehicle = Vehicle()
    calls = Calls(vehicle, firmware == "ardupilot")
    await calls.do("connect", lambda: vehicle.connect(url), 25.0)
    if vehicle.plugins:
        for part in (
            calls.telemetry, calls.parameters, calls.fences, calls.missions, calls.equipment, calls.flight,
            calls.takeoff,
        ):  # fmt: skip
            await part()


asyncio.run(main(*sys.argv[1:3]))
