"""What a flight asks for when it ranks candidates."""

from types import SimpleNamespace
from typing import Any, cast

from fvs_client import InVolume, Orbit, Shell
from fvs_client.fly.choice import Choice
from fvs_client.fly.settings import FlightSettings

VOLUME = InVolume(volume=Shell(centre=(0.0, 0.0, 0.0), inner=3.0, outer=5.0), count=20)


def asked(generator: Any) -> list[dict[str, Any]]:
    """What two rankings of a flight ask the scene for."""
    found: list[dict[str, Any]] = []

    def rank(candidates: Any, **given: Any) -> Any:
        found.append({"candidates": candidates, **given})
        pose = given["current_pose"]
        return SimpleNamespace(candidates=[SimpleNamespace(id="a", pose=pose)])

    state = SimpleNamespace(latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0, yaw_deg=90.0)
    vehicle = SimpleNamespace(state=state, last_state=state)
    settings = FlightSettings("north", 5, generator=generator, safety_m=2.0)
    choice = Choice(
        *(cast("Any", part) for part in (SimpleNamespace(rank=rank), vehicle, settings, None, None))
    )
    choice._rank(3)
    choice._rank(2)
    return found


def test_candidates_of_a_volume_keep_the_safety_distance_and_stay_the_same() -> None:
    first, second = asked(VOLUME)
    assert (first["generator"], first["safety_m"], first["candidates"]) == (VOLUME, 2.0, None)
    assert (second["generator"], second["safety_m"]) == (None, None)
    assert [candidate.id for candidate in second["candidates"]] == ["a"]


def test_other_candidates_have_no_safety_distance() -> None:
    assert asked(Orbit(count=4))[0]["safety_m"] is None
