"""Selections with travel as the budget, and with several vehicles, on a synthetic room with known poses."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
from selection_loops import loop_opener, run_to_end, smallest_scene

from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.reach import Reach
from fvs_engine.scene.dataset import Dataset
from fvs_engine.select.loop import Choice, SelectionLoop, StepRecord, StopReason

pytestmark = pytest.mark.usefixtures("all_native_here")

SCENE = smallest_scene(initial_iterations=1, iterations_per_view=0)
open_loop = loop_opener(scene=SCENE, initial=3, budget=12, nearest=99, method="farthest")


def decided(loop: SelectionLoop) -> list[tuple[str, int, tuple[int, ...], float]]:
    choices = [record.choice for record in loop.records]
    return [(choice.chosen, choice.vehicle, choice.landed, choice.distance) for choice in choices]


@pytest.fixture(scope="module")
def unlimited(room: Dataset, tmp_path_factory: pytest.TempPathFactory) -> SelectionLoop:
    """A selection by ``farthest`` without a limit. Tests must not change it."""
    loop = open_loop(tmp_path_factory.mktemp("unlimited"), room, budget=7)
    run_to_end(loop)
    return loop


def test_it_ends_before_the_view_that_would_exceed_the_travel(
    room: Dataset, tmp_path: Path, unlimited: SelectionLoop
) -> None:
    steps = [record.choice.distance for record in unlimited.records]
    exact, less = sum(steps[:3]), sum(steps[:3]) * 0.999
    for travel, count in ((exact, 3), (less, 2)):
        loop = open_loop(tmp_path / str(count), room, max_travel=travel)
        stop = run_to_end(loop)
        assert stop.kind == "travel"
        assert "The travel is used" in stop.message
        if count == 2:
            assert f"the next view, {unlimited.records[2].chosen}," in stop.message
        assert loop.visited == unlimited.visited[: 3 + count]
        (vehicle,) = loop.vehicles.all
        assert vehicle.flown == pytest.approx(sum(steps[:count]))
        assert loop.travel == pytest.approx(unlimited.records[count - 1].travel)
        centres = [room.centres()[name] for name in loop.visited]
        assert loop.travel == pytest.approx(path_length(centres))


def test_kriging_plans_within_the_travel(room: Dataset, tmp_path: Path, unlimited: SelectionLoop) -> None:
    """With a travel in which ``farthest`` visits two views."""
    travel = sum(record.choice.distance for record in unlimited.records[:2])
    loop = open_loop(tmp_path, room, method="kriging", max_travel=travel)
    stop = run_to_end(loop)
    assert stop.kind in ("travel", "budget")
    assert len(loop.visited) > 3 + 2
    assert loop.vehicles.all[0].flown <= travel * (1 + 1e-9)
    ends = [record.choice.outlook.end.variance for record in loop.records]
    free = open_loop(tmp_path / "free", room, method="kriging").choose(Monitor())
    assert isinstance(free, Choice)
    assert free.outlook.end.variance < ends[0] - 1e-3  # more can be had without a limit


def test_kriging_keeps_to_the_travel_where_reach_is_limited(room: Dataset, tmp_path: Path) -> None:
    spacing = float(np.median(np.linalg.norm(np.diff(list(room.centres().values()), axis=0), axis=1)))
    loop = open_loop(tmp_path, room, method="kriging", nearest=4, max_travel=5 * spacing)
    stop = run_to_end(loop)
    assert stop.kind == "travel"
    assert 0.0 < loop.vehicles.all[0].flown <= 5 * spacing * (1 + 1e-9)
    here = room.centres()[loop.visited[-1]]
    unvisited = {name: room.centres()[name] for name in loop.unvisited}
    nearest = min(Reach(nearest=1).distances(here, unvisited).values())
    assert nearest > 5 * spacing - loop.vehicles.all[0].flown  # nothing is left in the battery


@pytest.mark.parametrize("method", ["farthest", "kriging"])
def test_vehicles_take_turns_by_what_they_have_flown(room: Dataset, tmp_path: Path, method: str) -> None:
    loop = open_loop(tmp_path, room, method=method, vehicles=3, budget=8)
    assert run_to_end(loop).kind == "budget"
    centres = room.centres()
    at = dict.fromkeys((1, 2, 3), loop.initial[-1])
    flown = dict.fromkeys(at, 0.0)
    for record in loop.records:
        choice = record.choice
        assert choice.vehicle == min(flown, key=lambda number: (flown[number], number))
        distance = float(np.linalg.norm(centres[choice.chosen] - centres[at[choice.vehicle]]))
        assert choice.distance == pytest.approx(distance)
        at[choice.vehicle] = choice.chosen
        flown[choice.vehicle] += distance
    assert {choice.vehicle for choice in (record.choice for record in loop.records)} == {1, 2, 3}
    assert [vehicle.flown for vehicle in loop.vehicles.all] == pytest.approx(list(flown.values()))
    initial = path_length([centres[name] for name in loop.initial])
    assert loop.travel == pytest.approx(initial + sum(flown.values()))
    assert loop.records[-1].travel == pytest.approx(loop.travel)


def test_a_plan_that_vehicles_share_is_shorter_for_each_than_for_one(room: Dataset, tmp_path: Path) -> None:
    alone = open_loop(tmp_path / "alone", room, method="kriging", budget=8)
    run_to_end(alone)
    pair = open_loop(tmp_path / "pair", room, method="kriging", budget=8, vehicles=2)
    run_to_end(pair)
    assert len(pair.visited) == len(alone.visited)
    assert max(v.flown for v in pair.vehicles.all) < 0.8 * alone.vehicles.all[0].flown


def test_a_vehicle_that_has_landed_leaves_the_rest_to_the_others(room: Dataset, tmp_path: Path) -> None:
    one = open_loop(tmp_path / "one", room, max_travel=8.0)
    assert run_to_end(one).kind == "travel"
    two = open_loop(tmp_path / "two", room, max_travel=8.0, vehicles=2)
    assert run_to_end(two).kind == "travel"
    assert len(two.visited) > len(one.visited)
    assert all(vehicle.flown <= 8.0 * (1 + 1e-9) for vehicle in two.vehicles.all)
    landed: tuple[int, ...] = ()
    for record in two.records:
        assert set(landed) <= set(record.choice.landed)
        landed = record.choice.landed
        assert record.choice.vehicle not in landed
    assert landed  # one of them ended before the other


@pytest.mark.parametrize("method", ["farthest", "kriging"])
def test_it_goes_on_identically_after_a_stop_at_any_step(room: Dataset, tmp_path: Path, method: str) -> None:
    changes = {"method": method, "max_travel": 6.0, "vehicles": 2, "budget": 7}
    whole = open_loop(tmp_path / "whole", room, **changes)
    end = run_to_end(whole)
    resumed = open_loop(tmp_path / "resumed", room, **changes)
    for _ in range(20):  # after a choice and after a visit, by turns
        assert resumed.choose(Monitor()) is not None
        resumed = open_loop(tmp_path / "resumed", room, **changes)
        cancelled = Monitor()
        cancelled.cancel()
        with contextlib.suppress(Cancelled):
            resumed.step(cancelled)
        resumed = open_loop(tmp_path / "resumed", room, **changes)
        if isinstance(resumed.step(Monitor()), StopReason):
            break
    assert decided(resumed) == decided(whole)
    assert run_to_end(resumed) == end


def test_a_choice_is_made_once(room: Dataset, tmp_path: Path) -> None:
    loop = open_loop(tmp_path, room)
    choice = loop.choose(Monitor())
    assert isinstance(choice, Choice)
    assert loop.choose(Monitor()) == choice
    assert loop.visited == loop.initial
    assert open_loop(tmp_path, room).choose(Monitor()) == choice
    record = loop.step(Monitor())
    assert isinstance(record, StepRecord)
    assert record.chosen == choice.chosen


def test_a_travel_that_reaches_no_view_is_an_error_that_says_how_much_is_needed(
    room: Dataset, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match="reaches no view") as caught:
        open_loop(tmp_path, room, max_travel=1e-3)
    assert caught.value.hint is not None
    enough = float(caught.value.hint.split()[-1].rstrip("."))
    assert open_loop(tmp_path, room, max_travel=enough).settings.max_travel == enough
