"""Flights: a simulated vehicle, a real gateway, and a worker that the tests play."""

import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown, working
from fvs_client import Scene, VisitState
from fvs_client.fly.flight import Ending

from fvs_engine.lab.simulate.mavlink.flight_state import Faults, Mode

pytestmark = pytest.mark.process


@pytest.mark.system
@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_a_vehicle_flies_from_view_to_view(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, firmware: str
) -> None:
    with simulated(firmware=firmware) as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        result = flown.result()
        assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 5, 0, 0)
        assert not flown.vehicle.state.armed
    assert {image.name for image in scene.images.list()} == {f"{number:05d}.jpg" for number in range(1, 6)}
    assert all(image.prior is not None for image in scene.images.list())
    goes = [event["candidate"] for event in flown.events("goes")]
    assert len(set(goes)) == 2
    visits = {visit.candidate_id: visit.state for visit in scene.visits()}
    assert visits == dict.fromkeys(goes, VisitState.TAKEN)
    photographs = flown.events("photograph")
    assert [event["file"] for event in photographs] == [f"{number:05d}.jpg" for number in range(1, 6)]
    assert all(12.0 < event["height_m"] < 19.0 for event in photographs)
    assert len(flown.events("model")) == 3


@pytest.mark.system
def test_two_vehicles_share_a_scene(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with working(gateway, scene), ExitStack() as stack:
        flights = []
        for seed, name in enumerate(("north", "south")):
            simulator = stack.enter_context(simulated(name, seed))
            log = tmp_path / f"{name}.jsonl"
            flights.append(Flown(stack, simulator, scene, url, log, vehicle=name, photographs=6))
        results = [flown.result() for flown in flights]
    assert [(result.ending, result.photographs, result.unsent) for result in results] == [
        (Ending.BUDGET, 6, 0)
    ] * 2
    goes = [event["candidate"] for flown in flights for event in flown.events("goes")]
    assert len(goes) == len(set(goes)) >= 3  # no view twice
    visits = [(visit.vehicle, visit.state) for visit in scene.visits()]
    assert {vehicle for vehicle, _ in visits} == {"north", "south"}
    assert [state for _, state in visits] == [VisitState.TAKEN] * len(goes)
    assert len(list(scene.images.list())) == 12  # although both cameras number theirs from 0


@pytest.mark.system
def test_a_view_whose_photograph_fails_is_left_to_others(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        simulator.autopilot.faults.failing_photographs.add(4)  # after the test photograph and the survey
        result = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", photographs=4).result()
    assert (result.ending, result.photographs, result.failed) == (Ending.BUDGET, 4, 1)
    assert sorted(visit.state for visit in scene.visits()) == [VisitState.FAILED, VisitState.TAKEN]


def test_it_returns_when_it_is_asked_to(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        flown.flight.return_home()
        assert flown.result().ending is Ending.STOPPED
        assert not flown.vehicle.state.armed
        assert flown.events("landed")
    assert len(list(scene.images.list())) >= 1


@pytest.mark.system
def test_a_reserve_of_the_battery_brings_it_home(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated(endurance_s=300.0) as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", photographs=99, reserve=0.6)
        assert flown.result().ending is Ending.BATTERY
        assert 0.2 < flown.vehicle.state.battery < 0.6


@pytest.mark.system
def test_without_a_model_the_vehicle_returns_by_itself(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:  # nobody works on the update
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", patience_s=60.0)
        result = flown.result()
        assert result.ending is Ending.VEHICLE
        assert (result.photographs, result.unsent) == (3, 0)
        assert not flown.vehicle.state.armed


def test_a_scene_without_a_model_needs_a_survey(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", survey=None)
        result = flown.result()
        assert result.ending is Ending.NO_VIEW
        assert "--survey" in result.reason


@pytest.mark.system
def test_views_that_cannot_be_flown_are_named(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    fence = "47.376,8.541;47.376,8.54175;47.378,8.54175;47.378,8.541"  # the east is outside
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            photographs=9,
            survey=replace(SURVEY, start_deg=270.0),
            mission={"geofence": fence},
        )
        result = flown.result()
    assert result.ending is Ending.NO_VIEW
    assert 3 < result.photographs < 9
    assert any("geofence" in event["text"] for event in flown.events("refused"))


@pytest.mark.system
@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_legs_of_several_views(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, firmware: str
) -> None:
    with simulated(firmware=firmware) as simulator, working(gateway, scene), ExitStack() as stack:
        simulator.autopilot.faults.failing_photographs.add(5)  # the second of the first leg
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            photographs=7,
            leg_views=3,
        )
        result = flown.result()
    assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 7, 1, 0)
    first, second = (event["candidates"] for event in flown.events("goes"))
    assert (len(first), len(second)) == (3, 2)  # the second leg is what is left of the budget
    assert [event.get("candidate") for event in flown.events("photograph")] == [
        *[None] * 3,
        *(first[0], first[2]),
        *second,
    ]
    assert [event["candidate"] for event in flown.events("failed")] == [first[1]]
    states = {visit.candidate_id: visit.state for visit in scene.visits()}
    taken = dict.fromkeys([first[0], first[2], *second], VisitState.TAKEN)
    assert states == ({first[1]: VisitState.FAILED} | taken)
    assert len(flown.events("model")) == 3  # of the survey, and of each leg


@pytest.mark.system
def test_a_leg_leaves_out_views_that_cannot_be_flown(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    fence = "47.376,8.541;47.376,8.54175;47.378,8.54175;47.378,8.541"  # the east is outside
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            photographs=20,
            leg_views=8,
            survey=replace(SURVEY, start_deg=270.0),
            mission={"geofence": fence},
        )
        result = flown.result()
    assert result.ending is Ending.NO_VIEW
    goes = [name for event in flown.events("goes") for name in event["candidates"]]
    refused = {event["candidate"] for event in flown.events("refused")}
    assert goes
    assert refused
    assert not refused & set(goes)
    assert result.photographs == 3 + len(goes)
    assert len(goes) + len(refused) <= 8


@pytest.mark.parametrize("missing", ["camera", "gimbal"])
def test_a_vehicle_without_camera_or_gimbal_stays_on_the_ground(
    simulated: Any, scene: Scene, url: str, tmp_path: Path, missing: str
) -> None:
    faults = Faults(**{f"no_{missing}": True})
    with simulated(faults=faults) as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        result = flown.result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.VEHICLE
    assert f"reports no {missing}" in result.reason
    assert "--unchecked" in result.reason


@pytest.mark.system
def test_a_link_that_is_lost_in_mid_mission_comes_back(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url, silence_s=60.0)
        flown.wait_for("photograph", 1)
        link.cut = True
        flown.wait_for("silent", 1)
        until = time.monotonic() + 60.0
        while len(list(simulator.folder.glob("*.jpg"))) < 4:  # the vehicle flies on
            assert time.monotonic() < until
            time.sleep(0.05)
        link.cut = False
        result = flown.result()
    assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 5, 0, 0)
    assert flown.events("heard")
    files = [event["file"] for event in flown.events("photograph")]
    assert sorted(files) == [f"{number:05d}.jpg" for number in range(1, 6)]


@pytest.mark.system
def test_a_vehicle_that_stays_silent_is_said_to_fly_home(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            link=link.url,
            silence_s=1.0,
            patience_s=60.0,
        )
        flown.wait_for("photograph", 1)
        link.cut = True
        result = flown.result()
        assert result.ending is Ending.VEHICLE
        assert "ends at home" in result.reason
        assert flown.events("lost")
        until = time.monotonic() + 60.0
        while simulator.autopilot.vehicle.position[2] > 0.0:
            assert time.monotonic() < until
            time.sleep(0.05)
    assert result.unsent == 0
    assert len(list(scene.images.list())) >= 1


@pytest.mark.system
def test_a_landing_that_is_not_seen_is_a_failure(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            link=link.url,
            photographs=3,
            silence_s=1.0,
        )
        flown.wait_for("ends", 1)
        link.cut = True
        result = flown.result()
    assert (result.ending, result.photographs) == (Ending.VEHICLE, 3)
    assert "all 3 photographs are taken" in result.reason
    assert "Its landing was not seen" in result.reason


@pytest.mark.system
def test_a_mission_that_is_refused_in_the_air_brings_the_vehicle_home(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        simulator.autopilot.faults.refuses_missions = True
        result = flown.result()
        assert not flown.vehicle.state.armed
    assert result.ending is Ending.VEHICLE
    assert "MAV_MISSION_DENIED" in result.reason
    assert [visit.state for visit in scene.visits()] == [VisitState.FAILED]  # free for others
    assert (result.photographs, result.unsent) == (3, 0)


@pytest.mark.system
def test_a_mission_that_is_lost_on_the_way_to_a_waiting_vehicle_is_sent_again(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.2)
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url, photographs=4)
        flown.wait_for("photograph", 3)

        def cut_at_the_first_request(message: Any) -> list[Any]:
            if message.get_type() == "MISSION_REQUEST" and not cut:
                cut.append(simulator.autopilot.mode)
                link.cut = True
                return []
            return [message]

        cut: list[Mode] = []
        link.edit = cut_at_the_first_request
        flown.wait_for("silent", 1)
        assert simulator.autopilot.mode is Mode.MISSION  # of the last mission, which ends at home
        link.cut = False
        result = flown.result()
        assert not flown.vehicle.state.armed
    assert cut == [Mode.MISSION]
    assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 4, 0, 0)
