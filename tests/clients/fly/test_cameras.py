"""Flights with cameras that report their photographs in all ways, and in none."""

from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from flights import Flown, working
from fvs_client import Scene, VisitState
from fvs_client.fly.captures import Capture
from fvs_client.fly.connection import Equipment
from fvs_client.fly.dialects import ARDUPILOT
from fvs_client.fly.equipment import try_camera
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle

from fvs_engine.lab.simulate.mavlink.autopilot import Setup
from fvs_engine.lab.simulate.mavlink.flight_state import Faults

pytestmark = pytest.mark.process


def swapped() -> Any:
    """A relay's edit: each report of the camera comes twice, and after the next one; it has no position."""
    held: list[Any] = []

    def edit(message: Any) -> list[Any]:
        if message.get_type() == "CAMERA_FEEDBACK":
            return []
        if message.get_type() != "CAMERA_IMAGE_CAPTURED":
            return [message]
        held.append(message)
        return [] if len(held) % 2 else [held[-1], held[-2], held[-1]]

    return edit


@pytest.mark.system
@pytest.mark.parametrize(
    ("firmware", "reports"),
    [
        *(("ardupilot", reports) for reports in ("feedback", "captured", "both", "none", "swapped")),
        ("px4", "feedback"),
        ("px4", "both"),
    ],
)
def test_photographs_and_views_find_each_other(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    firmware: str,
    reports: str,
) -> None:
    setup = Setup(camera_reports="both" if reports == "swapped" else reports)  # type: ignore[arg-type]
    with (
        simulated(firmware=firmware, setup=setup) as simulator,
        working(gateway, scene),
        ExitStack() as stack,
    ):
        link = relay(simulator.url)
        if reports == "swapped":
            link.edit = swapped()
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            link=link.url,
            photographs=7,
            leg_views=2,
            photograph_s=60.0,  # each one comes
        )
        result = flown.result()
    assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 7, 0, 0)
    assert len(list(scene.images.list())) == 7
    goes = [name for event in flown.events("goes") for name in event["candidates"]]
    photographs = {event["file"]: event.get("candidate") for event in flown.events("photograph")}
    assert photographs == {f"{n:05d}.jpg": view for n, view in enumerate([*[None] * 3, *goes], start=1)}
    assert {visit.candidate_id: visit.state for visit in scene.visits()} == dict.fromkeys(
        goes, VisitState.TAKEN
    )
    assert not flown.events("failed")
    name = "on a wire, without a name" if reports in ("feedback", "none") else "fvs simulated"
    [camera] = [event["text"] for event in flown.events("check") if event["what"] == "camera"]
    assert camera == f"[ ok ] camera: {name}; photographs: 00000.jpg"


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_a_photograph_on_the_ground(simulated: Any, firmware: str) -> None:
    with simulated(firmware=firmware) as simulator, Vehicle(simulator.url) as vehicle:
        vehicle.equipment()
        vehicle.photograph()
        found: list[Any] = []
        vehicle.wait(lambda: bool(found.extend(vehicle.captures()) or found), 10.0, "reports nothing")
        assert found[0].succeeded
        assert len(list(simulator.folder.glob("*.jpg"))) == 1


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ({}, "reports that its photograph failed -> its storage and its mode"),
        ({"no_camera": True}, "refuses to photograph: The autopilot answers MAV_CMD_DO_DIGICAM_CONTROL"),
    ],
)
def test_a_camera_that_does_not_photograph_is_seen_on_the_ground(
    simulated: Any, scene: Scene, url: str, tmp_path: Path, settings: dict[str, Any], found: str
) -> None:
    faults = Faults(failing_photographs={0}, **settings)
    with simulated(faults=faults) as simulator, ExitStack() as stack:
        flown = Flown(
            stack,
            simulator,
            scene,
            url,
            tmp_path / "flight.jsonl",
            confirm=lambda checks: all(check.fine for check in checks if check.what == "camera"),
            equipment=False,
        )
        assert flown.result().ending is Ending.STOPPED
        assert simulator.autopilot.vehicle.flown_m == 0.0
    [camera] = [event["text"] for event in flown.events("check") if event["what"] == "camera"]
    assert camera.startswith("[LOOK]")
    assert found in camera


def _tried(monkeypatch: pytest.MonkeyPatch, captures: list[Capture], **state: Any) -> str:
    """The line of the checklist where no file comes."""
    monkeypatch.setattr("fvs_client.fly.equipment._PHOTOGRAPH_S", 0.3)
    heard = iter([[], captures])
    commands: list[str] = []
    vehicle = SimpleNamespace(
        state=VehicleState(**state),
        dialect=ARDUPILOT,
        captures=lambda: next(heard, []),
        photograph=lambda: commands.append("photograph"),
        recover_captures=lambda: commands.append("recover"),
    )
    photographs = SimpleNamespace(tested=lambda **_: None, folder=Path("camera"))
    line = str(try_camera(vehicle, Equipment("", None), photographs, lambda: None))  # type: ignore[arg-type]
    assert commands == ([] if state else ["photograph", "recover"])
    return line


def test_a_camera_without_an_answer_and_one_without_a_file_are_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wire = "on a wire, without a name"
    assert (
        _tried(monkeypatch, [])
        == f"[LOOK] camera: {wire}; does not photograph: no report and no file in 0 s -> CAM1_TYPE, its "
        "cable and its trigger"
    )
    assert (
        _tried(monkeypatch, [Capture(0, True, "")])
        == f"[LOOK] camera: {wire}; reports a photograph, but no file came into camera -> --photographs, or "
        "how its files come there; a later one would be taken for the first view's"
    )
    assert (
        _tried(monkeypatch, [], armed=True)
        == f"[ ok ] camera: {wire}; not tried, because the vehicle is armed"
    )


@pytest.mark.system
def test_a_camera_that_px4_does_not_trigger(simulated: Any) -> None:
    """``TRIG_MODE`` 0, as it is by default: nobody answers, and missions photograph nothing."""
    with simulated(firmware="px4") as simulator, Vehicle(simulator.url) as vehicle:
        simulator.autopilot._pilot._board.parameters._values["TRIG_MODE"] = 0.0
        with pytest.raises(VehicleError, match="camera trigger does not answer"):
            vehicle.photograph()
        assert list(simulator.folder.glob("*.jpg")) == []
