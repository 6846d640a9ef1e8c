"""Flights with cameras that report their photographs in all ways, and in none."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown, working
from fvs_client import Scene, VisitState
from fvs_client.fly.flight import Ending
from fvs_client.fly.vehicle import Vehicle

from fvs_engine.lab.simulate.mavlink.autopilot import Setup

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
@pytest.mark.parametrize("reports", ["feedback", "captured", "both", "none", "swapped"])
def test_photographs_and_views_find_each_other(
    simulated: Any, relay: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, reports: str
) -> None:
    setup = Setup(camera_reports="both" if reports == "swapped" else reports)  # type: ignore[arg-type]
    with simulated(setup=setup) as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        if reports == "swapped":
            link.edit = swapped()
        flown = Flown(
            stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url, photographs=7, leg_views=2
        )
        result = flown.result()
    assert (result.ending, result.photographs, result.failed, result.unsent) == (Ending.BUDGET, 7, 0, 0)
    assert len(list(scene.images.list())) == 7
    goes = [name for event in flown.events("goes") for name in event["candidates"]]
    photographs = {event["file"]: event.get("candidate") for event in flown.events("photograph")}
    assert photographs == {f"{n:05d}.jpg": view for n, view in enumerate([*[None] * 3, *goes])}
    assert {visit.candidate_id: visit.state for visit in scene.visits()} == dict.fromkeys(
        goes, VisitState.TAKEN
    )
    assert not flown.events("failed")


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_a_photograph_on_the_ground(simulated: Any, firmware: str) -> None:
    with simulated(firmware=firmware) as simulator, Vehicle(simulator.url) as vehicle:
        vehicle.equipment()
        vehicle.photograph()
        found: list[Any] = []
        vehicle.wait(lambda: bool(found.extend(vehicle.captures()) or found), 10.0, "reports nothing")
        assert found[0].succeeded
        assert len(list(simulator.folder.glob("*.jpg"))) == 1
