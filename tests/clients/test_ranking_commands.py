"""Rankings, plans and candidates on the command line."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from fvs_schema.scenes import Alignment, AlignmentStatus

Run = Callable[..., Result]


def test_candidates_that_the_method_did_not_render_are_rendered(
    run: Run, gateway: Any, scene_id: str, tmp_path: Path
) -> None:
    gateway.model(scene_id)
    here = tmp_path / "here.json"
    here.write_text(json.dumps({"position": [90.0, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}))
    far = ("--current", here, "--radius", 1, "--count", 2, "--renders", tmp_path / "views")
    assert "%" not in run("rank", scene_id, *far).stdout  # no coverage was measured
    kinds = sorted(path.stem.rpartition("-")[2] for path in (tmp_path / "views").iterdir())
    assert kinds == ["render", "render", "spectrum", "spectrum"]


def test_a_flight_is_planned(run: Run, gateway: Any, scene_id: str, tmp_path: Path) -> None:
    assert "no model" in run("plan", scene_id, expect=3).stderr
    snapshot_id = gateway.model(scene_id)
    lines = run("plan", scene_id, "--count", "8", "--views", "3").stdout.splitlines()
    assert lines[0].split()[:5] == ["vehicle", "stop", "id", "distance", "travel"]
    assert [line.split()[:2] for line in lines[1:4]] == [["1", "1"], ["1", "2"], ["1", "3"]]
    assert lines[-1].startswith("3 more photographs, ")
    assert lines[-1].endswith(f" on {snapshot_id}.")
    (listed,) = json.loads(run("plans", "list", scene_id, "--json").stdout)
    assert f" {listed['id']} on " in lines[-1]
    assert listed["id"] in run("plans", "list", scene_id).stdout
    assert run("plans", "show", listed["id"]).stdout.splitlines() == lines
    run("plans", "delete", listed["id"], "--yes")
    run("plans", "show", listed["id"], expect=6)
    pose = {"position": [0.0, -4.0, 0.5], "orientation_wxyz": [0.7071068, -0.7071068, 0.0, 0.0]}
    candidates, here, there = (tmp_path / name for name in ("candidates.json", "here.json", "there.json"))
    row = [{"id": f"c{x}", "pose": pose | {"position": [x, -4.0, 0.5]}} for x in (1.0, 2.0, 7.0)]
    candidates.write_text(json.dumps(row))
    here.write_text(json.dumps(pose))
    there.write_text(json.dumps(pose | {"position": [8.0, -4.0, 0.5]}))
    given = ["--candidates", candidates, "--vehicle", here, "--vehicle", there]
    document = json.loads(run("plan", scene_id, *given, "--views", 3, "--home", "--json").stdout)
    flown = [[stop["id"] for stop in tour["stops"]] for tour in document["tours"]]
    assert flown[1] == ["c7.0"]
    assert set(flown[0]) == {"c1.0", "c2.0"}
    assert "does not reach" in run("plan", scene_id, *given, "--distance", 0.5, expect=3).stderr
    assert "not both" in run("plan", scene_id, *given, "--generator", "grid", expect=2).stderr
    for other in (given, ["--generator", "grid"]):
        assert "--count is for orbit" in run("plan", scene_id, *other, "--count", 5, expect=2).stderr


def test_tables_have_the_unit_of_lengths_where_there_is_one(run: Run, gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    planned = run("plan", scene, "--count", "8", "--views", "1").stdout.splitlines()[0]
    assert planned.split()[:7] == ["vehicle", "stop", "id", "distance", "(m)", "travel", "(m)"]
    assert "distance (m)" in run("rank", scene, "--generator", "orbit", "--count", 4).stdout


@pytest.mark.system
def test_a_flight_is_planned_in_a_volume(run: Run, gateway: Any, scene_id: str, tmp_path: Path) -> None:
    gateway.model(scene_id)
    volume, zone, wrong = (tmp_path / name for name in ("volume.json", "zone.json", "wrong.json"))
    volume.write_text(json.dumps({"kind": "shell", "centre": [0, 0, 0], "inner": 3, "outer": 5}))
    zone.write_text(json.dumps({"kind": "cylinder", "base": [0, 0, -9], "radius": 3.5, "height": 18}))
    wrong.write_text(json.dumps({"kind": "shell", "centre": [0, 0, 0]}))
    given = ["plan", scene_id, "--volume", volume, "--count", 30, "--views", 4]
    document = json.loads(run(*given, "--safety", 0.2, "--no-fly", zone, "--level", "--json").stdout)
    assert len(document["candidates"]) == 30
    poses = [stop["pose"] for tour in document["tours"] for stop in tour["stops"]]
    assert all(math.hypot(*pose["position"][:2]) > 3.5 for pose in poses)
    table = run(*given, "--safety", 0.2, "--no-fly", zone).stdout
    via = sum(len(stop["via"]) for tour in document["tours"] for stop in tour["stops"])
    assert via > 0
    assert " via " in table
    run(*given, "--aim", "nearest")
    run(*given, "--aim", "0,0.5,1")
    assert "is not middle, nearest or X,Y,Z" in run(*given, "--aim", "up", expect=2).stderr
    assert "need a --volume" in run("plan", scene_id, "--level", expect=2).stderr
    assert "inner" in run("plan", scene_id, "--volume", wrong, expect=2).stderr
    assert "not both" in run(*given, "--generator", "grid", expect=2).stderr
    assert "safety distance" in run(*given, "--safety", 1e5, expect=3).stderr


def test_candidates_of_a_volume_are_ranked(run: Run, gateway: Any, scene_id: str, tmp_path: Path) -> None:
    gateway.model(scene_id)
    volume, zone = (tmp_path / name for name in ("volume.json", "zone.json"))
    volume.write_text(json.dumps({"kind": "shell", "centre": [0, 0, 0], "inner": 3, "outer": 5}))
    zone.write_text(json.dumps({"kind": "cylinder", "base": [0, 0, -9], "radius": 3.5, "height": 18}))
    given = ["rank", scene_id, "--volume", volume, "--count", 30]
    document = json.loads(run(*given, "--safety", 0.2, "--no-fly", zone, "--level", "--json").stdout)
    assert document["total"] == 30
    poses = [item["pose"] for item in document["candidates"]]
    assert all(math.hypot(*pose["position"][:2]) > 3.5 for pose in poses)
    assert document["request"]["safety_m"] == 0.2
    run(*given, "--aim", "nearest")
    assert "need a --volume" in run("rank", scene_id, "--aim", "nearest", expect=2).stderr
    assert "not both" in run(*given, "--generator", "grid", expect=2).stderr
    assert "safety distance" in run(*given, "--safety", 1e5, expect=3).stderr


@pytest.mark.system
def test_vehicles_get_different_views(run: Run, gateway: Any, scene_id: str, tmp_path: Path) -> None:
    gateway.model(scene_id)
    pose = {"position": [0.0, -4.0, 0.5], "orientation_wxyz": [0.7071068, -0.7071068, 0.0, 0.0]}
    file = tmp_path / "views.json"
    file.write_text(
        json.dumps([{"id": f"c{x}", "pose": pose | {"position": [x, -4.0, 0.5]}} for x in (1, 2)])
    )
    ask = ["rank", scene_id, "--candidates", file, "--json"]
    ranking = json.loads(run(*ask).stdout)
    first, second = (item["id"] for item in ranking["candidates"])
    lines = run("visit", scene_id, "going-to", "--vehicle", "north", "--ranking", ranking["id"]).stdout
    assert lines.splitlines()[1].split()[:3] == ["north", "going-to", first]
    taken = json.loads(run(*ask, "--for-vehicle", "south").stdout)["candidates"]
    assert [(item["id"], item["status"]) for item in taken] == [(second, "ranked"), (first, "taken")]
    plan = json.loads(run("plan", scene_id, "--candidates", file, "--for-vehicle", "north", "--json").stdout)
    assert len(plan["tours"][0]["stops"]) == 2
    given = ["--ranking", ranking["id"], "--candidate", first]
    assert (
        "north flies to" in run("visit", scene_id, "going-to", "--vehicle", "south", *given, expect=3).stderr
    )
    listed = json.loads(run("visits", scene_id, "--json").stdout)["visits"]
    assert [item["candidate_id"] for item in listed] == [first]
    run("visit", scene_id, "taken", "--vehicle", "south", "--candidates", file)
    assert len(run("visits", scene_id).stdout.splitlines()) == 4
    wrong = ["visit", scene_id, "taken", "--vehicle", "south"]
    assert "Give the views" in run(*wrong, expect=2).stderr
    assert "needs a --ranking" in run(*wrong, "--candidates", file, "--candidate", "c1", expect=2).stderr
    assert "no candidate c9" in run(*wrong, "--ranking", ranking["id"], "--candidate", "c9", expect=2).stderr


def test_candidates_come_from_a_file(run: Run, gateway: Any, scene_id: str, tmp_path: Path) -> None:
    gateway.model(scene_id)
    pose = {"position": [0.0, -4.0, 0.5], "orientation_wxyz": [0.7071068, -0.7071068, 0.0, 0.0]}
    file, current = tmp_path / "candidates.json", tmp_path / "here.json"
    file.write_text(json.dumps([{"id": "south", "pose": pose}]))
    current.write_text(json.dumps(pose | {"position": [0.0, -9.0, 0.5]}))
    near = json.loads(run("rank", scene_id, "--candidates", file, "--json").stdout)
    assert [(item["id"], item["status"]) for item in near["candidates"]] == [("south", "ranked")]
    far = json.loads(
        run("rank", scene_id, "--candidates", file, "--current", current, "--radius", 2, "--json").stdout
    )
    assert [(item["status"], item["distance_m"]) for item in far["candidates"]] == [("out-of-range", 5.0)]
    file.write_text('[{"id": "south", "pose": {"position": [0, 0, 0]}}]')
    assert "orientation_wxyz" in run("rank", scene_id, "--candidates", file, expect=2).stderr
    file.write_text('{"id": "south"}')
    assert '[{"id": "left",' in run("rank", scene_id, "--candidates", file, expect=2).stderr
    assert "--current" in run("rank", scene_id, "--radius", 2, expect=2).stderr
    run("rank", scene_id, "--candidates", file, "--generator", "grid", expect=2)
