"""What a flight asks for when it ranks candidates."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
from fvs_client import AltitudeDatum, InVolume, Orbit, Shell
from fvs_client.fly.choice import Choice
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.places import Home
from fvs_client.fly.settings import EndedError, FlightSettings

from fvs_schema.candidates import AroundCurrent, CandidateStatus
from fvs_schema.scenes import Origin
from fvs_schema.terrain import Terrain

VOLUME = InVolume(volume=Shell(centre=(0.0, 0.0, 0.0), inner=3.0, outer=5.0), count=20)


def asked(generator: Any) -> list[dict[str, Any]]:
    """What two rankings of a flight ask the scene for."""
    found: list[dict[str, Any]] = []

    def rank(candidates: Any, **given: Any) -> Any:
        found.append({"candidates": candidates, **given})
        pose = given["current_pose"]
        return SimpleNamespace(candidates=[SimpleNamespace(id="a", pose=pose, status=CandidateStatus.RANKED)])

    state = SimpleNamespace(
        latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0, height_m=15.0, yaw_deg=90.0
    )
    vehicle = SimpleNamespace(home=Home(47.0, 8.0, 485.0), last_state=state)
    settings = FlightSettings("north", 5, generator=generator, safety_m=2.0, radius_m=30.0)
    watch = SimpleNamespace(airborne=False)
    choice = Choice(
        *(cast("Any", part) for part in (SimpleNamespace(rank=rank), vehicle, settings, watch, None))
    )
    choice._rank(3)
    watch.airborne = True
    choice._rank(2)
    return found


def test_candidates_of_a_volume_keep_the_safety_distance_and_stay_the_same() -> None:
    first, second = asked(VOLUME)
    assert (first["generator"], first["safety_m"], first["candidates"]) == (VOLUME, 2.0, None)
    assert (second["generator"], second["safety_m"]) == (None, 2.0)
    assert (first["radius_m"], second["radius_m"]) == (None, 30.0)  # the way from home may be longer
    assert [candidate.id for candidate in second["candidates"]] == ["a"]


def test_other_candidates_keep_the_safety_distance_as_well() -> None:
    assert asked(Orbit(count=4))[0]["safety_m"] == 2.0


@pytest.mark.parametrize(
    ("datum", "altitude_m"),
    [(AltitudeDatum.SEA_LEVEL, 500.0), (AltitudeDatum.TAKEOFF, 15.0), (AltitudeDatum.ELLIPSOID, 548.5)],
)
def test_the_vehicle_says_where_it_is_in_the_datum_of_the_scene(
    datum: AltitudeDatum, altitude_m: float
) -> None:
    state = SimpleNamespace(
        latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0, height_m=15.0, yaw_deg=90.0
    )
    vehicle = SimpleNamespace(home=Home(47.0, 8.0, 485.0), last_state=state)
    origin = Origin(latitude_deg=47.0, longitude_deg=8.0, altitude_m=0.0, altitude_datum=datum)

    def choice(**mission: float) -> Choice:
        settings = FlightSettings("north", 5, mission=cast("Any", mission))
        parts = (SimpleNamespace(), vehicle, settings, None, None)
        return Choice(*(cast("Any", part) for part in parts))

    if datum is AltitudeDatum.ELLIPSOID:
        with pytest.raises(VehicleError, match="ellipsoid") as caught:
            choice().use_datum(origin)
        assert "--geoid" in caught.value.hint
    found = choice(geoid_height_m=48.5)
    found.use_datum(origin)
    assert (found._pose().altitude_datum, found._pose().altitude_m) == (datum, altitude_m)


NOTCHED = "0,0;0,0.01;0.01,0.01;0.01,0.006;0.002,0.005;0.01,0.004;0.01,0"
"""A square with a notch from the north, between a view in the north-west and one in the north-east."""
HOME = (0.001, 0.005)
WEST, EAST, BELOW = (0.008, 0.002), (0.008, 0.008), (0.001, 0.002)


def flying(told: list[str], **limits: Any) -> tuple[Any, SimpleNamespace, list[Terrain | None]]:
    """A flight with a ranking of the views `east` and `below`, that flies at `WEST`.

    Its next views, its watch, and the terrains that it ranks with.
    """
    asked: list[Terrain | None] = []
    places = {"east": EAST, "below": BELOW}

    def rank(*_: Any, **given: Any) -> Any:
        pose = given["current_pose"]
        asked.append(given["terrain"])
        ranked = [
            SimpleNamespace(id=name, rank=number, pose=pose, status=CandidateStatus.RANKED)
            for number, name in enumerate(places)
        ]
        return SimpleNamespace(id="rnk_1", candidates=ranked, origin=None)

    def mission(views: Any, *_: Any, **__: Any) -> Any:
        latitude, longitude = places[views[0].id]
        lines = [f"0 0 0 16 0 0 0 0 {HOME[0]} {HOME[1]} 0 1", f"1 0 3 16 0 1 0 0 {latitude} {longitude} 9 1"]
        text = "\n".join(["QGC WPL 110", *(line.replace(" ", "\t") for line in lines)])
        return SimpleNamespace(content=text.encode(), left_out=(), reasons=())

    state = SimpleNamespace(
        latitude_deg=WEST[0], longitude_deg=WEST[1], altitude_m=9.0, height_m=9.0, yaw_deg=0.0
    )
    scene = SimpleNamespace(rank=rank, mission=mission, report_visits=lambda *_, **__: None)
    vehicle = SimpleNamespace(
        home=Home(*WEST, 0.0), last_state=state, dialect=SimpleNamespace(autopilot="ardupilot")
    )
    watch = SimpleNamespace(trying=lambda ask: ask(), airborne=True)
    log = SimpleNamespace(event=lambda _kind, text, *_, **__: told.append(text))
    settings = FlightSettings("north", 5, generator=Orbit(count=2), **limits)
    parts = (scene, vehicle, settings, watch, log)
    return lambda: Choice(*(cast("Any", part) for part in parts)).next(1).views, watch, asked


def test_a_view_behind_a_notch_of_the_geofence_is_left_out() -> None:
    """Both views can be flown to from home, but the way between them leaves the geofence."""
    told: list[str] = []
    views, watch, _ = flying(told, mission={"geofence": NOTCHED})
    assert [view.id for view in views()] == ["below"]
    assert told[0] == "east is left out: the way to it from where the vehicle is leaves the geofence."
    watch.airborne = False  # it takes off at home, from where the service has checked the way
    assert [view.id for view in views()] == ["east"]


def test_a_view_behind_a_ridge_is_left_out() -> None:
    """The vehicle and both views are 9 m above home; a ridge of 20 m lies between the west and the east."""
    ridge = [20.0 if 4 <= column <= 6 else 0.0 for column in range(11)]
    terrain = Terrain(
        south_deg=-0.001,
        west_deg=-0.001,
        latitude_step_deg=0.001,
        longitude_step_deg=0.001,
        columns=len(ridge),
        heights_m=tuple(ridge * 12),
    )
    told: list[str] = []
    heights = SimpleNamespace(around=lambda *_: terrain)
    views, watch, asked = flying(told, terrain=heights)
    assert [view.id for view in views()] == ["below"]
    said = "east is left out: the way to it from where the vehicle is is too low over 0.008000, 0.00"
    assert told[0].startswith(said)
    assert told[0].endswith("-11.0 m above the ground.")
    (ranked_with,) = asked
    assert ranked_with is not None
    assert ranked_with.height_m(WEST) == 0.0  # home is at the scene's 0 m, as the vehicle says
    watch.airborne = False
    assert [view.id for view in views()] == ["east"]


def test_why_no_candidate_has_a_rank_is_said_with_the_options_that_change_it() -> None:
    statuses = (
        [CandidateStatus.OUT_OF_RANGE] * 3 + [CandidateStatus.VISITED] + [CandidateStatus.TOO_CLOSE] * 2
    )
    ranking = SimpleNamespace(
        id="rnk_1",
        origin=None,
        candidates=[SimpleNamespace(id="a", rank=None, pose=None, status=status) for status in statuses],
    )
    state = SimpleNamespace(
        latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0, height_m=15.0, yaw_deg=90.0
    )
    vehicle = SimpleNamespace(home=Home(47.0, 8.0, 485.0), last_state=state)
    scene = SimpleNamespace(rank=lambda *_, **__: ranking)
    watch = SimpleNamespace(trying=lambda ask: ask(), airborne=True)
    settings = FlightSettings("north", 5, generator=AroundCurrent(), radius_m=5.0)
    choice = Choice(*(cast("Any", part) for part in (scene, vehicle, settings, watch, None)))
    with pytest.raises(EndedError) as ended:
        choice.next(1)
    assert ended.value.reason == (
        "no view can be flown to: none of 6 candidates has a rank: 3 out-of-range (--radius), "
        "2 too-close (--safety), 1 visited."
    )
