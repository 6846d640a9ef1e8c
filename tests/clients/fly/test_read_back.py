"""What an autopilot keeps of a mission: differences that are no faults, and those that are."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_client.fly.dialects import ARDUPILOT, PX4, Dialect
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import Command, Frame, MissionItem
from fvs_client.fly.read_back import difference
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import common as mavlink

VIEW = MissionItem(
    Command.WAYPOINT, Frame.RELATIVE, (0.0, 1.0, 0.0, 300.0), 47.3767732, 8.5420480, 12.950023651
)
MOUNT = MissionItem(Command.MOUNT_CONTROL, Frame.MISSION, (-6.136600017547607, 0.0, 0.0, 0.0), z=2.0)
WAIT = MissionItem(
    Command.LOITER_TIME, Frame.RELATIVE, (200.0, 0.0, 0.0, 300.0), 47.3767732, 8.5420480, 12.95
)
TURN = MissionItem(Command.CONDITION_YAW, Frame.MISSION, (300.0, 0.0, 0.0, 0.0))
SHOOT = MissionItem(Command.DIGICAM_CONTROL, Frame.MISSION, x=1.0)


def kept(
    item: MissionItem, *parameters: float, frame: int = 3, z: float = 0.0, **more: Any
) -> SimpleNamespace:
    """An item as it is read back."""
    x, y = item.encoded
    named = dict(zip(("param1", "param2", "param3", "param4"), parameters, strict=True))
    return SimpleNamespace(
        **{"command": item.command, "frame": frame, "x": x, "y": y, "z": z, **named, **more}
    )


@pytest.mark.parametrize(
    ("dialect", "item", "got"),
    [
        (ARDUPILOT, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 0.0, z=12.949999809)),
        (ARDUPILOT, MOUNT, kept(MOUNT, -6.1366, 0.0, 0.0, 0.0, frame=0)),
        (ARDUPILOT, WAIT, kept(WAIT, 200.0, 0.0, 1.0, 0.0, z=12.949999809)),
        (ARDUPILOT, TURN, kept(TURN, 300.0, 0.0, 0.0, 0.0, frame=0)),
        (ARDUPILOT, SHOOT, kept(SHOOT, 0.0, 0.0, 0.0, 0.0, frame=0)),
        (PX4, VIEW, kept(VIEW, 0.0, 1.0, 0.0, 300.00003, frame=6, z=12.950023651)),
        (PX4, MOUNT, kept(MOUNT, -6.1366, 0.0, 0.0, 0.0, frame=2, z=2.0)),
    ],
)  # fmt: skip
def test_what_autopilots_change_of_an_item_is_no_fault(dialect: Dialect, item: MissionItem, got: Any) -> None:
    assert difference(item, got, dialect) is None


@pytest.mark.parametrize(
    ("dialect", "item", "got", "what"),
    [
        (ARDUPILOT, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 0.0, z=12.93), "its altitude is 12.93 m"),
        (ARDUPILOT, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 0.0, z=12.95, frame=0), "its frame is 0 instead of 3"),
        (ARDUPILOT, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 0.0, z=12.95, y=85420499), "it is at 47.3767732, 8.54"),
        (ARDUPILOT, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 0.0, z=12.95, command=19), "its command is 19"),
        (ARDUPILOT, MOUNT, kept(MOUNT, -6.13, 0.0, 0.0, 0.0, frame=0), "its parameter 1 is -6.13 instead"),
        (ARDUPILOT, WAIT, kept(WAIT, 20.0, 0.0, 1.0, 0.0, z=12.95), "its parameter 1 is 20 instead of 200"),
        (ARDUPILOT, SHOOT, kept(SHOOT, 0.0, 0.0, 0.0, 0.0, frame=0, x=0), "it is at"),
        (PX4, VIEW, kept(VIEW, 0.0, 0.0, 0.0, 300.0, frame=6, z=12.95), "its parameter 2 is 0 instead of 1"),
        (PX4, VIEW, kept(VIEW, 0.0, 1.0, 0.0, math.nan, frame=6, z=12.95), "its parameter 4 is nan"),
    ],
)  # fmt: skip
def test_what_changes_a_flight_is_a_fault(dialect: Dialect, item: MissionItem, got: Any, what: str) -> None:
    found = difference(item, got, dialect)
    assert found is not None
    assert what in found


def test_a_yaw_is_the_same_after_a_full_turn() -> None:
    north = replace(VIEW, parameters=(0.0, 1.0, 0.0, 360.0))
    assert difference(north, kept(north, 0.0, 1.0, 0.0, 0.0, frame=6, z=12.95), PX4) is None


@pytest.mark.process
def test_a_mission_that_the_vehicle_changes_silently_is_refused(simulated: Any, relay: Any) -> None:
    survey = Survey(47.3769, 8.5417, radius_m=25.0, height_m=12.0, count=3)
    items = survey.items(ARDUPILOT)
    view = next(number for number, item in enumerate(items) if number and item.command == Command.WAYPOINT)

    def lower(message: Any) -> list[Any]:
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == view:
            message.z -= 1.0
            message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
        return [message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = lower
        other = rf"another mission than the one that was sent: item {view} .* altitude"
        with Vehicle(link.url) as vehicle, pytest.raises(VehicleError, match=other):
            vehicle.upload(items)
