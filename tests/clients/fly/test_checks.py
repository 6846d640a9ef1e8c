"""Checks before takeoff: the battery, and the failsafe for lost ground stations."""

import struct
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown
from fvs_client import Scene
from fvs_client.fly.checks import warn_of_failsafe
from fvs_client.fly.flight import Ending
from fvs_client.fly.log import FlightLog
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import common as mavlink

pytestmark = pytest.mark.process


def _of_vehicle(message: Any) -> Any:
    message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    return message


def _without_battery(message: Any) -> list[Any]:
    if message.get_type() != "SYS_STATUS":
        return [message]
    fields = (0, 0, 0, 0, 65_535, -1, -1, 0, 0, 0, 0, 0, 0)
    return [_of_vehicle(mavlink.MAVLink_sys_status_message(*fields))]


def test_a_vehicle_without_a_battery_is_not_flown_with_a_reserve(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.checks._BATTERY_S", 0.5)
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = _without_battery
        log = tmp_path / "flight.jsonl"
        result = Flown(stack, simulator, scene, url, log, link=link.url).result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.VEHICLE
    assert "reports no battery" in result.reason
    assert "--unchecked" in result.reason


@pytest.mark.system
@pytest.mark.parametrize(("settings", "warned"), [({"equipment": False}, True), ({"reserve": 0.0}, False)])
def test_a_vehicle_without_a_battery_is_flown_without_a_reserve(
    simulated: Any,
    relay: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    settings: dict[str, Any],
    warned: bool,
) -> None:
    monkeypatch.setattr("fvs_client.fly.checks._BATTERY_S", 0.5)
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = _without_battery
        log = tmp_path / "flight.jsonl"
        flown = Flown(stack, simulator, scene, url, log, link=link.url, **settings)
        flown.wait_for("photograph", 1)
        flown.flight.return_home()
        assert flown.result().ending is Ending.STOPPED
    texts = [event["text"] for event in flown.events("warning")]
    assert any("reports no battery" in text for text in texts) is warned


@pytest.mark.parametrize(
    ("firmware", "name", "value", "warning"),
    [
        ("ardupilot", "FS_GCS_ENABLE", 0.0, "FS_GCS_ENABLE is 0"),
        ("ardupilot", "FS_GCS_ENABLE", 1.0, None),
        ("ardupilot", "FS_GCS_ENABLE", None, "does not tell FS_GCS_ENABLE"),
        ("px4", "NAV_DLL_ACT", 0.0, "NAV_DLL_ACT is 0"),
        ("px4", "NAV_DLL_ACT", struct.unpack("<f", struct.pack("<i", 2))[0], None),  # as PX4 sends integers
    ],
)
def test_a_failsafe_that_is_off_is_warned_of(
    simulated: Any, relay: Any, firmware: str, name: str, value: float | None, warning: str | None
) -> None:
    def edit(message: Any) -> list[Any]:
        if message.get_type() != "PARAM_VALUE":
            return [message]
        assert message.param_id == name
        if value is None:
            return []
        return [_of_vehicle(mavlink.MAVLink_param_value_message(name.encode(), value, 6, 1, 0))]

    said: list[str] = []
    with simulated(firmware=firmware) as simulator:
        link = relay(simulator.url)
        link.edit = edit
        with Vehicle(link.url) as vehicle:
            warn_of_failsafe(vehicle, FlightLog(None, said.append))
    if warning is None:
        assert said == []
    else:
        [text] = said
        assert warning in text
        assert "between two missions" in text
