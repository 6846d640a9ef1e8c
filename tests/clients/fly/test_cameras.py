"""Flights with cameras that report their photographs in all ways, and in none."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown, working
from fvs_client import Scene, VisitState
from fvs_client.fly.flight import Ending
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import ardupilotmega

pytestmark = pytest.mark.process


def feedback(message: Any) -> Any:
    """The ``CAMERA_FEEDBACK`` of an ArduCopter whose camera hangs on a servo, for a report of a camera."""
    place = (message.lat, message.lon, message.alt / 1e3, message.relative_alt / 1e3)
    sent = ardupilotmega.MAVLink_camera_feedback_message(
        message.time_boot_ms * 1_000, 0, 0, message.image_index + 1, *place, *(0.0,) * 4, 0, 0
    )
    sent.pack(ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1))
    return sent


def reports(kind: str) -> Any:
    """What a relay makes of the reports of photographs."""
    late: list[Any] = []

    def edit(message: Any) -> list[Any]:
        if message.get_type() not in ("CAMERA_IMAGE_CAPTURED", "CAMERA_CAPTURE_STATUS"):
            return [message]
        if message.get_type() == "CAMERA_CAPTURE_STATUS":
            return [message] if kind in ("both", "swapped") else []
        match kind:
            case "feedback":
                return [feedback(message)] * 2
            case "both":
                return [feedback(message), message, message]
            case "swapped":  # each report comes after the next one
                late.append(message)
                return [] if len(late) % 2 else [late[-1], late[-2]]
        return []

    return edit


@pytest.mark.system
@pytest.mark.parametrize("kind", ["feedback", "both", "swapped", "none"])
def test_photographs_and_views_find_each_other(
    simulated: Any, relay: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, kind: str
) -> None:
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = reports(kind)
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


def test_a_photograph_on_the_ground(simulated: Any) -> None:
    for firmware in ("ardupilot", "px4"):
        with simulated(firmware, firmware=firmware) as simulator, Vehicle(simulator.url) as vehicle:
            vehicle.equipment()
            vehicle.photograph()
            vehicle.wait(lambda: bool(list(simulator.folder.glob("*.jpg"))), 10.0, "takes no photograph")
            assert [found.succeeded for found in vehicle.captures()] == [True]
