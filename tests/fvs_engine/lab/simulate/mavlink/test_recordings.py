"""The simulated copter sends what ArduCopter sent, message for message, when the same is asked of it."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase
from recordings import Line, mission, received, recorded, sequence, states
from simulators import Station, flown_by_station

from fvs_engine.lab.simulate.vehicle import Limits

pytestmark = pytest.mark.process

AUTO, GUIDED, RTL, BRAKE = 3, 4, 6, 17
LIMITS = Limits(yaw_rate_deg_s=90.0)
"""A slower turn would outlast the wait for the gimbal, in which ArduCopter turns, too."""


def subsequence(short: list[Any], long: list[Any]) -> bool:
    rest = iter(long)
    return all(each in rest for each in short)


def replay(station: Station, lines: list[Line]) -> list[Line]:
    """Do what the ground station of a recording did, when it did it; returns what the vehicle sent."""
    begin = len(station.heard)
    items: list[Line] = []
    for index, line in enumerate(lines):
        kind = line["message"]
        if line["from"] != "255/191" or kind in ("HEARTBEAT", "REQUEST_DATA_STREAM", "PARAM_REQUEST_READ"):
            continue
        if kind == "MISSION_COUNT":
            items = mission(lines[index:])
            station.upload(items)
        elif kind == "MISSION_SET_CURRENT":
            station.mav.mission_set_current_send(1, 1, line["seq"])
        elif kind == "COMMAND_LONG":
            if line["t"] > 20.0 and line["command"] == mavlink.MAV_CMD_DO_SET_MODE:  # where it waited
                at = states(lines[:index])[-1][0]
                station.next("MISSION_CURRENT", lambda message, at=at: message.seq == at, 60.0)
                station.listen(0.3)
            parameters = [line[f"param{number}"] for number in range(1, 8)]
            station.command(line["command"], *parameters, component=line["target_component"])
    station.next("HEARTBEAT", lambda message: message.base_mode == 81, 60.0)
    station.listen(0.3)
    return received(station)[begin:]


def test_a_flight_of_two_legs_is_told_as_arducopter_tells_it(tmp_path: Path) -> None:
    lines = recorded("flight")
    with flown_by_station(tmp_path, limits=LIMITS, speed_up=20.0) as (_simulator, station):
        sent = replay(station, [line for line in lines if line["t"] > 1.5])
    for kind in (
        "CAMERA_FEEDBACK",
        "COMMAND_ACK",
        "MISSION_ACK",
        "MISSION_ITEM_REACHED",
        "MISSION_REQUEST",
        "PARAM_VALUE",
        "STATUSTEXT",
    ):
        assert sequence(sent, kind) == sequence((line for line in lines if line["t"] > 1.5), kind), kind
    real = sequence(lines, "CAMERA_IMAGE_CAPTURED", "1/100")
    assert sequence(sent, "CAMERA_IMAGE_CAPTURED", "1/100") == real
    assert subsequence(sequence(sent, "HEARTBEAT"), sequence(lines, "HEARTBEAT"))
    modes = [mode for _, mode, _ in sequence(sent, "HEARTBEAT")]
    assert [mode for mode, after in zip(modes, [*modes[1:], -1], strict=True) if mode != after][-5:] == [
        GUIDED, AUTO, GUIDED, AUTO, RTL
    ]  # fmt: skip
    assert subsequence(states(sent), states(lines))
    assert {state[0] for state in states(sent)} >= {9, 8}  # where it waited


def test_a_pause_resets_the_gimbal_and_resuming_does_not_point_it_again(tmp_path: Path) -> None:
    lines, items = recorded("pause-and-resume"), mission(recorded("flight"))
    with flown_by_station(tmp_path, limits=LIMITS, speed_up=20.0) as (simulator, station):
        assert station.upload(items) == mavlink.MAV_MISSION_ACCEPTED
        station.until_text("Flight plan received")
        begin = len(station.heard)
        station.mode(GUIDED)
        station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        station.command(mavlink.MAV_CMD_MISSION_START)
        station.until_text("Mission: 3 MountControl")
        while abs(simulator.autopilot.vehicle.pitch_deg - items[3]["param1"]) > 0.1:  # it turns for a while
            time.sleep(0.005)
        station.mode(BRAKE)
        real_deg = recorded_pitch_deg(lines, 22.5)
        station.next("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda each: abs(pitch_of(each.q) - real_deg) < 0.5)
        station.mode(AUTO)
        station.next("CAMERA_FEEDBACK")
        assert pitch_deg(station) == pytest.approx(recorded_pitch_deg(lines, 30.0), abs=0.5)
        station.next("MISSION_CURRENT", lambda message: message.seq == 9)
        station.mode(RTL)
        station.next("HEARTBEAT", lambda message: message.base_mode == 81, 60.0)
        sent = received(station)[begin:]
        real = [line for line in lines if line["t"] > 15.43]
        for kind in ("CAMERA_FEEDBACK", "MISSION_ITEM_REACHED", "STATUSTEXT"):
            assert sequence(sent, kind) == sequence(real, kind), kind
        assert simulator.autopilot.vehicle.pitch_deg == pytest.approx(-30.0)


def test_a_return_that_is_an_item_keeps_the_mode(tmp_path: Path) -> None:
    lines, items = recorded("landing-interrupted"), mission(recorded("flight"))
    with flown_by_station(tmp_path, limits=LIMITS, speed_up=20.0) as (simulator, station):
        station.upload(items)
        station.until_text("Flight plan received")
        begin = len(station.heard)
        station.mode(GUIDED)
        station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        station.command(mavlink.MAV_CMD_MISSION_START)
        station.until_text("Mission: 10 RTL")
        while simulator.autopilot.vehicle.position[2] > 9.0:
            time.sleep(0.02)
        station.listen(0.2)
        sent, real = received(station)[begin:], [line for line in lines if 14.36 < line["t"] < 65.0]
        for kind in ("CAMERA_FEEDBACK", "MISSION_ITEM_REACHED", "STATUSTEXT"):
            assert sequence(sent, kind) == sequence(real, kind), kind
        assert sequence(sent, "HEARTBEAT")[-1] == sequence(real, "HEARTBEAT")[-1] == (217, AUTO, 4)
        assert states(sent)[-1] == states(real)[-1] == (10, 10, 3, 1)
        station.next("HEARTBEAT", lambda message: message.base_mode in (81, 89), 60.0)
        assert station.texts()[-1] == "Disarming motors"


def test_home_and_flags_of_sensors_are_as_recorded(tmp_path: Path) -> None:
    lines = recorded("pause-and-resume")
    names = ("present", "enabled", "health")
    real = {
        tuple(line[f"onboard_control_sensors_{name}"] for name in names) for line in kept(lines, "SYS_STATUS")
    }
    with flown_by_station(tmp_path) as (simulator, station):
        sent = set()
        for fixed, armed in ((False, False), (True, False), (True, True)):
            simulator.autopilot.faults.no_fix = not fixed
            station.listen(0.5)
            if armed:
                station.mode(GUIDED)
                begin = len(station.heard)
                station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
                assert kept(received(station)[begin:], "HOME_POSITION")  # before the motors are armed
            station.listen(0.3)
            status = station.next("SYS_STATUS")
            sent.add(tuple(getattr(status, f"onboard_control_sensors_{name}") for name in names))
    assert sent <= real
    assert len(sent) == 3


def kept(lines: list[Line], name: str) -> list[Line]:
    return [line for line in lines if line["message"] == name]


def pitch_deg(station: Station) -> float:
    station.next("GIMBAL_DEVICE_ATTITUDE_STATUS")
    return pitch_of(station.next("GIMBAL_DEVICE_ATTITUDE_STATUS").q)


def recorded_pitch_deg(lines: list[Line], at_s: float) -> float:
    found = min(kept(lines, "GIMBAL_DEVICE_ATTITUDE_STATUS"), key=lambda line: abs(line["t"] - at_s))
    return pitch_of(found["q"])


def pitch_of(quaternion: list[float]) -> float:
    return float(math.degrees(QuaternionBase(np.divide(quaternion, np.linalg.norm(quaternion))).euler[1]))
