"""Missions cut to a battery: parts begin and end at home, are short enough, and as few as possible."""

import csv
from collections.abc import Callable, Sequence
from itertools import chain, pairwise
from typing import Any

import numpy as np
import pymap3d
import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.parts import fewest_parts
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_schema.missions import MissionFile, MissionFormat, MissionOptions, MissionView
from fvs_schema.mistakes import InvalidInput
from fvs_schema.poses import VehiclePose
from fvs_schema.snapshots import PinholeIntrinsics
from fvs_schema.terrain import Terrain

LATITUDE, LONGITUDE, HOME_M = 46.02, 7.75, 500.0
HOME = {"home_latitude_deg": LATITUDE, "home_longitude_deg": LONGITUDE, "home_altitude_m": HOME_M}
CAMERA = PinholeIntrinsics(width_px=640, height_px=480, fx_px=500, fy_px=500, cx_px=320, cy_px=240)
Write = Callable[..., MissionFile]


def _pose(east_m: float, height_m: float) -> VehiclePose:
    latitude, longitude, altitude = pymap3d.enu2geodetic(east_m, 0, height_m, LATITUDE, LONGITUDE, HOME_M)
    return VehiclePose(
        latitude_deg=float(latitude),
        longitude_deg=float(longitude),
        altitude_m=float(altitude),
        yaw_deg=90.0,
        pitch_deg=-30.0,
    )


def _view(name: str, east_m: float, height_m: float = 20.0, via: Any = ()) -> MissionView:
    return MissionView(id=name, pose=_pose(east_m, height_m), via=via)


@pytest.fixture
def write(scene: Callable[..., WorldFrame]) -> Write:
    def write(
        views: Sequence[MissionView], *, via_home: Any = (), terrain: Terrain | None = None, **options: Any
    ) -> MissionFile:
        wanted = MissionOptions.model_validate({"format": "csv", **HOME, **options})
        return write_mission("m", scene(), views, via_home, wanted, None, CAMERA, terrain)

    return write


def _rows(file: MissionFile) -> list[dict[str, str]]:
    return list(csv.DictReader(file.content.decode().splitlines()))


def _flown_s(file: MissionFile, *, takes_off: bool = True) -> float:
    """The time of a part from the ground at home to the ground at home, from its table alone."""
    rows = _rows(file)
    way = [
        (float(row["latitude_deg"]), float(row["longitude_deg"]), float(row["altitude_m"])) for row in rows
    ]
    home = (LATITUDE, LONGITUDE)
    start = [(*home, 0.0)] if takes_off else []
    way = [*start, (*home, max(2.0, way[0][2])), *way, (*home, way[-1][2]), (*home, 0.0)]
    enu = [pymap3d.geodetic2enu(*place, LATITUDE, LONGITUDE, 0.0) for place in way]
    seconds = 20.0  # the last metres of the landing
    for before, after in pairwise(enu):
        east, north, up = np.subtract(after, before)
        climb_s = up / 2.5 if up > 0.0 else -up / 1.5
        seconds += max(float(np.hypot(east, north)) / 5.0, climb_s) + 2.4 * 5.0**0.5
    return seconds + sum(4.0 + 4.0 + 1.0 for row in rows if row["id"])


def _parts(write: Write, views: Sequence[MissionView], **options: Any) -> list[MissionFile]:
    count = write(views, **options).parts
    return [write(views, part=part, **options) for part in range(1, count + 1)]


def _names(parts: Sequence[MissionFile]) -> list[list[str]]:
    return [[row["id"] for row in _rows(part) if row["id"]] for part in parts]


def test_parts_are_numbered_and_no_longer_than_a_battery_lasts(write: Write) -> None:
    views = [_view(f"v{number}", east) for number, east in enumerate((50, 250, 40, 240, 30))]
    options = {"battery_s": 250, "battery_reserve": 0.0}
    parts = _parts(write, views, **options)
    assert [part.name for part in parts] == ["m-1-of-2.csv", "m-2-of-2.csv"]
    assert _names(parts) == [["v0", "v1", "v2"], ["v3", "v4"]]
    assert [round(_flown_s(part)) for part in parts] == [201, 182]
    assert [part.name for part in _parts(write, views[:3], **options)] == ["m-1-of-1.csv"]
    assert write(views).name == "m.csv"
    assert write(views).parts == 1


def test_the_reserve_is_not_flown(write: Write) -> None:
    views = [_view(f"v{number}", east) for number, east in enumerate((50, 250, 40))]
    for battery_s, parts in ((290, 1), (280, 2)):  # 203 s and 196 s; together it takes 201 s
        assert write(views, battery_s=battery_s).parts == parts
    assert write(views, battery_s=290, battery_reserve=0.4).parts == 3


@pytest.mark.parametrize("options", [{}, {"transit_height_m": 60.0}, {"takeoff": False}], ids=str)
def test_another_view_never_fits_into_a_part(write: Write, options: dict[str, Any]) -> None:
    generator = np.random.default_rng(3)
    views = [_view(f"v{number}", *generator.uniform((20, 5), (200, 50)).tolist()) for number in range(20)]
    options = {**options, "battery_s": 400.0, "battery_reserve": 0.25}
    parts = _parts(write, views, **options)
    assert len(parts) > 2
    names = _names(parts)
    assert list(chain(*names)) == [view.id for view in views]
    for part, following in pairwise(names):
        longer = views[int(part[0][1:]) : int(following[0][1:]) + 1]
        assert write(longer, **options).parts == 2
    for part in parts:
        flown_s = _flown_s(part, takes_off=options.get("takeoff", True))
        assert flown_s <= 300.0 + 0.01
        assert part.duration_s == pytest.approx(flown_s, abs=0.01)


def test_a_flight_has_a_length_and_a_duration(write: Write) -> None:
    def route(**options: Any) -> tuple[float, float]:
        file = write([_view("a", 100), _view("b", 200)], **options)
        assert file.views == 2
        assert file.length_m is not None
        assert file.duration_s is not None
        return round(file.length_m), round(file.duration_s)

    stop_s, view_s = 2.4 * 5.0**0.5, 9.0
    nowhere = {"home_latitude_deg": None, "home_longitude_deg": None, "home_altitude_m": None}
    assert route(**nowhere) == (100, round(20 + stop_s + 2 * view_s))
    assert route(finish="hold") == (220, round(8 + 40 + 3 * stop_s + 2 * view_s))
    # Where the altitude of home is not known, neither are the climb and the way down.
    assert route(home_altitude_m=None) == (400, round(80 + 3 * stop_s + 2 * view_s + 20))
    poses = write([_view("a", 100)], format="nerfstudio")
    assert (poses.views, poses.length_m, poses.duration_s) == (1, None, None)
    assert route(speed_m_s=10.0, hold_s=0.0) == (440, round(8 + 40 + 13.33 + 12 * 10**0.5 + 10 + 20))


def test_a_detour_at_home_goes_with_the_first_and_the_last_view(write: Write) -> None:
    first = _view("a", 100, via=(_pose(50, 70),))
    views = [first, _view("b", 100, via=(_pose(100, 80),)), _view("c", 100, via=(_pose(100, 90),))]
    parts = _parts(write, views, battery_s=240, battery_reserve=0.0, via_home=(_pose(50, 75),))
    heights = [[round(float(row["altitude_m"])) for row in _rows(part)] for part in parts]
    assert heights == [[70, 20], [20], [20, 75]]
    assert _names(parts) == [["a"], ["b"], ["c"]]
    (whole,) = _parts(write, views, battery_s=1000, via_home=(_pose(50, 75),))
    assert [round(float(row["altitude_m"])) for row in _rows(whole)] == [70, 20, 80, 20, 90, 20, 75]


def test_a_view_that_is_out_of_reach_is_refused_or_left_out(write: Write) -> None:
    views = [_view("near", 50), _view("far", 400), _view("beside", 60)]
    reason = "to it alone and back it takes 232 s; a battery of 250 s flies 175 s and keeps a reserve of 30%"
    with pytest.raises(InvalidRequestError, match="The view far cannot be flown") as refused:
        write(views, battery_s=250)
    assert [(error.field, error.message) for error in refused.value.errors] == [("far", reason)]
    left = write(views, battery_s=250, leave_out=True)
    assert (left.left_out, left.reasons, left.parts) == (("far",), (reason,), 1)
    assert _names([left]) == [["near", "beside"]]
    with pytest.raises(InvalidRequestError, match="No view is left"):
        write(views[1:2], battery_s=250, leave_out=True)


def test_parts_need_home_and_return_to_it(write: Write) -> None:
    views = [_view("a", 50)]
    with pytest.raises(InvalidRequestError, match="battery_s is measured from home"):
        write(views, battery_s=500, home_altitude_m=None)
    nowhere: dict[str, Any] = {"home_latitude_deg": None, "home_longitude_deg": None}
    for wrong, said in (
        (nowhere, "home, which is missing"),
        ({"finish": "hold"}, "the vehicle returns"),
        ({"battery_reserve": 0.95}, "must be at most 0.9"),
        ({"battery_s": float("nan")}, "finite"),
    ):
        with pytest.raises(InvalidInput, match=said):
            MissionOptions(**{"format": MissionFormat.CSV, **HOME, "battery_s": 500, **wrong})
    with pytest.raises(InvalidRequestError, match="part: the mission has 1 part, counted from 1"):
        write(views, battery_s=500, part=2)
    with pytest.raises(InvalidRequestError) as refused:
        write(views, part=2)
    assert "Give battery_s" in refused.value.hint


def test_every_format_has_the_same_parts(write: Write) -> None:
    views = [_view(f"v{number}", 200 + number) for number in range(3)]
    for name in MissionFormat:
        options = {"battery_reserve": 0.0, "format": name, "autopilot": "px4"}
        parts = _parts(write, views, battery_s=200, **options)
        assert [part.parts for part in parts] == [1]
        parts = _parts(write, [*views, _view("w", 20), *views], battery_s=250, **options)
        assert [part.parts for part in parts] == [2, 2]
        assert len({part.content for part in parts}) == 2
        assert all(f"-{number}-of-2." in part.name for number, part in enumerate(parts, start=1))


def test_the_ways_of_a_cut_are_over_the_terrain(write: Write) -> None:
    """The ways home and out at a cut are checked against a hill between home and the views."""
    step = 1e-4
    row = [500.0 + (60.0 if 5 <= column <= 7 else 0.0) for column in range(40)]
    hill = Terrain(
        south_deg=LATITUDE - 2 * step,
        west_deg=LONGITUDE - 2 * step,
        latitude_step_deg=step,
        longitude_step_deg=step,
        columns=40,
        heights_m=tuple(row * 5),
    )
    over = (_pose(35, 80),)
    views = [_view("a", 100, via=over), _view("b", 120), _view("c", 100)]
    with pytest.raises(InvalidRequestError) as refused:
        write(views, battery_s=230, battery_reserve=0.0, terrain=hill, via_home=over)
    reasons = {error.field: error.message for error in refused.value.errors}
    assert "under ground" in reasons["b"]
    assert write(views, battery_s=900, terrain=hill, via_home=over).parts == 1
    views = [_view("a", 100), _view("b", 118), _view("c", 100), _view("d", 118)]
    parts = _parts(write, views, battery_s=400, terrain=hill, transit_height_m=10.0)
    assert _names(parts) == [["a", "b", "c"], ["d"]]
    assert [max(round(float(row["altitude_m"])) for row in _rows(part)) for part in parts] == [70, 70]


def test_cuts_are_as_few_as_all_cuts_allow() -> None:
    generator = np.random.default_rng(7)
    for _ in range(200):
        count = int(generator.integers(1, 8))
        away, between, back = generator.uniform(0, 10, (3, count))
        away[generator.random(count) < 0.2] = np.inf
        found = fewest_parts(away, between, back, 20.0)
        fewest = []
        for cuts in range(2 ** (count - 1)):
            starts = [0, *(index for index in range(1, count) if cuts >> (index - 1) & 1), count]
            lengths = [
                away[start] + between[start + 1 : stop].sum() + back[stop - 1]
                for start, stop in pairwise(starts)
            ]
            if max(lengths) <= 20.0:
                fewest.append(len(lengths))
        assert (None if found is None else len(found)) == min(fewest, default=None)
        if found is not None:
            assert list(chain(*found)) == list(range(count))
