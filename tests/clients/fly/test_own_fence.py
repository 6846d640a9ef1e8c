"""The vehicle's own fence: uploaded from a geofence, read back, and refused."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown
from fvs_client import Scene
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.own_fence import OwnFence
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulators import Station

from fvs_engine.lab.simulate.mavlink.flight_state import Faults
from fvs_schema.fence import Fence

pytestmark = pytest.mark.process

GEOFENCE = "47.3759,8.5407;47.3759,8.5427;47.3779,8.5427;47.3779,8.5407"
FENCE = Fence.parse(GEOFENCE)
OTHER = Fence.parse("47.3769,8.5417;47.3769,8.5427;47.3779,8.5427")


def _confirming(stack: ExitStack, simulator: Any, scene: Scene, url: str, log: Path, **more: Any) -> Flown:
    """A flight that ends at the checklist."""
    settings = {"upload_fence": True, "mission": {"geofence": GEOFENCE}, **more}
    return Flown(stack, simulator, scene, url, log, confirm=lambda _checks: False, **settings)


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_the_geofence_becomes_the_vehicles_own_fence(
    simulated: Any, scene: Scene, url: str, tmp_path: Path, firmware: str
) -> None:
    with simulated(firmware=firmware) as simulator, ExitStack() as stack:
        flown = _confirming(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        assert flown.result().ending is Ending.STOPPED
        own = flown.vehicle.fence()
        assert own is not None
        assert own.is_same(FENCE)
        assert not own.is_same(OTHER)
        assert simulator.autopilot.mission == ()
    [line] = [event["text"] for event in flown.events("check") if event["what"] == "vehicle's fence"]
    assert "; its polygon is --geofence -> " in line
    assert ("FENCE_ENABLE 1, FENCE_ALT_MAX" if firmware == "ardupilot" else "GF_ACTION 3") in line
    assert flown.events("fence")


def test_without_being_asked_to_the_fence_stays_as_it_is(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        with Vehicle(simulator.url) as vehicle:
            assert vehicle.fence() == OwnFence()
            vehicle.replace_fence(OTHER)
        flown = _confirming(stack, simulator, scene, url, tmp_path / "flight.jsonl", upload_fence=False)
        flown.result()
        own = flown.vehicle.fence()
        assert own is not None
        assert own.is_same(OTHER)
    [line] = [event["text"] for event in flown.events("check") if event["what"] == "vehicle's fence"]
    assert "; --geofence is not inside its polygon -> " in line
    assert "--upload-fence, or a smaller --geofence" in line


def test_a_vehicle_that_refuses_a_fence_stays_on_the_ground(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated(faults=Faults(refuses_missions=True)) as simulator, ExitStack() as stack:
        result = _confirming(stack, simulator, scene, url, tmp_path / "flight.jsonl").result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.VEHICLE
    assert "The autopilot refuses the fence: MAV_MISSION_DENIED" in result.reason


def test_the_fence_of_an_armed_vehicle_is_not_replaced(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        vehicle.arm()
        with pytest.raises(VehicleError, match="armed: its fence is not replaced"):
            vehicle.replace_fence(FENCE)
        assert vehicle.fence() == OwnFence()


def test_a_fence_that_another_program_changes_is_noticed(simulated: Any, relay: Any) -> None:
    def moved(message: Any) -> list[Any]:
        if message.get_type() != "MISSION_ITEM_INT":
            return [message]
        message.x += 2
        message.pack(vehicles_voice)
        return [message]

    vehicles_voice = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = moved
        with Vehicle(link.url) as vehicle, pytest.raises(VehicleError, match="has another fence than"):
            vehicle.replace_fence(FENCE)


def test_circles_and_zones_to_stay_outside_are_counted(simulated: Any) -> None:
    with simulated() as simulator:
        station = Station(simulator.url)
        place = {"x": 473769000, "y": 85417000}
        circle = {"command": 5003, "param1": 90.0, **place}
        corner = {"command": 5002, "param1": 3.0, **place}
        assert station.upload([circle, corner, corner, corner], kind=1) == 0
        station.link.close()
        with Vehicle(simulator.url) as vehicle:
            assert vehicle.fence() == OwnFence((), others=2)
