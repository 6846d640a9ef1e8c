"""`fvs-client mission`, and files that commands cannot write."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine
from typer.testing import Result

from fvs_schema.scenes import Alignment, AlignmentStatus
from fvs_schema.terrain import Terrain

Run = Callable[..., Result]


def _said(result: Result) -> str:
    """What a command wrote to stderr, where the log of the gateway in this process goes, too."""
    return "".join(
        line for line in result.stderr.splitlines(keepends=True) if not line.startswith('{"method"')
    )


@pytest.mark.system
def test_rankings_and_plans_become_missions(run: Run, gateway: Any, tmp_path: Path) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    snapshot = gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    ranking = json.loads(run("rank", scene, "--generator", "orbit", "--count", 4, "--json").stdout)["id"]
    fence, home = "46.01,7.74;46.03,7.74;46.03,7.76;46.01,7.76", ("--home", "46.02,7.75,495")
    heights = ("--transit-height", 40, "--lowest", 0, "--highest", 120)
    flown = (*heights, "--geofence", fence, "--speed", 3, "--gimbal", -90, 0)
    written = run("mission", ranking, *home, *flown, "--out", tmp_path)
    assert written.stdout.strip() == str(tmp_path / f"{ranking}.plan")
    plan = json.loads((tmp_path / f"{ranking}.plan").read_text())
    assert plan["mission"]["hoverSpeed"] == 3.0
    assert plan["mission"]["plannedHomePosition"] == [46.02, 7.75, 495.0]
    assert len(plan["geoFence"]["polygons"][0]["polygon"]) == 4
    out = tmp_path / "next.kmz"
    options = ("--format", "dji-kmz", "--drone", "m30", "--in-the-air", "--finish", "hold", "--first", 1)
    document = json.loads(run("mission", ranking, *home, *options, "--out", out, "--json").stdout)
    kind = "application/vnd.google-earth.kmz"
    assert document == {"files": [str(out)], "media_type": kind, "left_out": [], "reasons": []}
    tour = tmp_path / "plan.json"
    tour.write_text(run("plan", scene, "--count", 8, "--views", 3, "--json").stdout)
    waypoints = tmp_path / "plan.waypoints"
    run("mission", tour, "--format", "qgc-wpl", "--autopilot", "px4", "--out", waypoints)
    assert waypoints.read_text().startswith("QGC WPL 110")
    planned = json.loads(tour.read_text())
    planned["tours"][0]["stops"][1]["pose"]["altitude_m"] = 900.0
    tour.write_text(json.dumps(planned))
    stop = planned["tours"][0]["stops"][1]["id"]
    flown = (*home, "--format", "csv", "--lowest", 0, "--highest", 99)
    left = run("mission", tour, *flown, "--out", out, "--leave-out")
    reason = "it is 405.0 m above home; the highest allowed is 99 m"
    assert _said(left) == f"Warning: {stop} is left out: {reason}.\n"
    left = run("mission", tour, *flown, "--out", out, "--leave-out", "--json")
    assert json.loads(left.stdout)["reasons"] == [reason]
    one = ("mission", ranking, *home, "--format", "csv", "--first", 1, "--json", "--out", tmp_path / "cut")
    alone = json.loads(run(*one, "--battery", 1000).stdout)["files"]
    assert alone == [str(tmp_path / "cut" / f"{ranking}-1-of-1.csv")]
    halved = json.loads(
        run(*one[:-6], *one[-4:], "--format", "csv", "--battery", 220, "--reserve", 0.5).stdout
    )["files"]
    assert [Path(file).name for file in halved] == [f"{ranking}-{part}-of-2.csv" for part in (1, 2)]
    assert all(Path(file).is_file() for file in halved)
    again = ("mission", snapshot, "--format", "csv", "--json", "--out", tmp_path / "again.csv", "--leave-out")
    run(*again, *home, "--lowest", -50)
    assert (tmp_path / "again.csv").read_text().count("sha256:") == 6
    assert "With a snapshot it is `points`" in run(*again, *home, "--terrain", tour, expect=2).stderr
    newer = gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    gateway.client.delete(f"/v1/snapshots/{snapshot}")
    assert run("mission", tour, "--format", "csv", "--out", out, "--leave-out", "--json").exit_code == 0
    assert newer != snapshot
    assert "is no id of a ranking, plan or snapshot" in run("mission", "nothing", expect=2).stderr
    for place in ("north", "nan,7.75", "46,7,inf", "46", "1,2,3,4"):
        assert "is not LAT,LON" in run("mission", ranking, "--home", place, expect=2).stderr
    assert "`--home` must be at most 90." in run("mission", ranking, "--home", "91,7.75", expect=2).stderr
    refused = run("mission", ranking, "--geofence", "46.01,7.74", expect=2).stderr
    assert "--geofence: a fence has 3 to 200 corners" in refused
    by_id = run("mission", planned["id"], "--format", "csv", "--out", tmp_path).stdout.strip()
    assert by_id == str(tmp_path / f"{planned['id']}.csv")
    refused = run("mission", tour, "--vehicle", 2, expect=2).stderr
    assert "The plan is for 1 vehicle; `--vehicle` counts from 1." in refused
    written = run("mission", ranking, "--format", "csv", "--out", f"{tmp_path}/new/folder/").stdout.strip()
    assert written == str(tmp_path / "new" / "folder" / f"{ranking}.csv")


@pytest.mark.system
def test_a_height_model_is_the_ground_of_rankings_and_plans(run: Run, gateway: Any, tmp_path: Path) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    ranking = json.loads(run("rank", scene, "--generator", "orbit", "--count", 4, "--json").stdout)
    plan = tmp_path / "plan.json"
    plan.write_text(run("plan", scene, "--count", 8, "--views", 3, "--json").stdout)
    dem = tmp_path / "ground.tif"
    profile = {"width": 400, "height": 400, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    corner = Affine(1e-5, 0.0, 7.748, 0.0, -1e-5, 46.022)
    with rasterio.open(dem, "w", driver="GTiff", transform=corner, nodata=-9999, **profile) as file:
        file.write(np.full((1, 400, 400), 480.0, dtype=np.float32))
    over = ("--home", "46.02,7.75", "--terrain", dem, "--out", tmp_path)
    for what in (ranking["id"], plan, json.loads(plan.read_text())["id"]):
        run("mission", what, *over, "--format", "qgc-plan", "--above-ground")
    document = json.loads((tmp_path / f"{scene}.plan").read_text())
    frames = [item["frame"] for item in document["mission"]["items"] if item["command"] == 16]
    assert set(frames) == {10}
    heights = [item["Altitude"] for item in document["mission"]["items"] if item["command"] == 16]
    first = ranking["candidates"][0]["pose"]["altitude_m"]
    run("mission", ranking["id"], *over, "--format", "csv", "--first", 1)
    row = (tmp_path / f"{scene}.csv").read_text().splitlines()[1].split(",")
    assert float(row[5]) == pytest.approx(first - 480.0, abs=0.01)
    assert all(height > 0.0 for height in heights)
    with rasterio.open(dem, "r+") as file:
        file.write(np.full((1, 400, 400), first + 7.0, dtype=np.float32))
    asked = ("rank", scene, "--generator", "orbit", "--count", 4, "--terrain", dem, "--json")
    statuses = {item["status"] for item in json.loads(run(*asked).stdout)["candidates"]}
    assert "under-ground" in statuses
    assert "ranked" not in statuses
    refused = run("mission", ranking["id"], *over, "--format", "csv", "--first", 1, expect=3).stderr
    assert "it is under ground: 7.0 m below the terrain" in refused
    said = run("mission", ranking["id"], "--terrain", dem, expect=2).stderr
    assert "With --terrain, home must be given." in said
    said = run("mission", ranking["id"], "--home", "47,8", "--terrain", plan, expect=2).stderr
    assert "is no height model" in said
    said = run("mission", ranking["id"], "--home", "46.02,7.75", "--above-ground", expect=3).stderr
    assert "a terrain is missing" in said


def test_home_above_the_takeoff_of_the_photographs(run: Run, gateway: Any, tmp_path: Path) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    aligned = Alignment(status=AlignmentStatus.ALIGNED, scale=10.0, takeoff_altitude_m=450.0)
    snapshot = gateway.model(scene, alignment=aligned)
    again = ("mission", snapshot, "--lowest", -100, "--format", "csv", "--out", tmp_path / "again.csv")
    said = run(*again, "--home", "46.02,7.75,480", expect=3).stderr
    assert "their flight took off at 450.0 m" in said
    assert "Instead of ALT in --home LAT,LON,ALT, give --home-above-takeoff: 0 to take off where" in said
    run(*again, "--home", "46.02,7.75", "--home-above-takeoff", 0)
    heights = [float(row.split(",")[5]) for row in (tmp_path / "again.csv").read_text().splitlines()[1:]]
    assert all(30.0 < height < 70.0 for height in heights)
    both = run(*again, "--home", "46.02,7.75,480", "--home-above-takeoff", 0, expect=2).stderr
    assert "Give ALT in --home LAT,LON,ALT or --home-above-takeoff" in both


def test_missions_are_refused_in_the_words_of_the_command_line(run: Run, gateway: Any) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    ranking = json.loads(run("rank", scene, "--generator", "orbit", "--count", 4, "--json").stdout)["id"]
    flat = gateway.scene()
    gateway.model(flat)
    nowhere = json.loads(run("rank", flat, "--generator", "orbit", "--count", 4, "--json").stdout)["id"]
    home = ("--home", "46.02,7.75,495")
    help_hint = "`fvs-client mission --help` describes the options."
    for given, said in (
        ((ranking, *home, "--lowest", 5, "--highest", 5), ["--lowest is not below --highest.", help_hint]),
        ((ranking, *home, "--lowest", 50, "--highest", 60), ["or leave these views out with --leave-out."]),
        (
            (ranking, *home, "--lowest", 50, "--highest", 60, "--leave-out"),
            ["Error: No view is left.", "\nChange the options, or choose other candidates.\n"],
        ),
        (
            (ranking, *home, "--format", "mavsdk", "--altitudes", "ellipsoid"),
            ["MAVSDK has no altitudes above the ellipsoid.", "It can have --altitudes takeoff."],
        ),
        (
            (ranking, "--format", "mavsdk"),
            [
                "Give ALT in --home LAT,LON,ALT, the altitude of the place of takeoff above sea level, or ",
                "or --geoid, the height of the geoid",
            ],
        ),
        ((ranking, "--transit-height", 30), ["--transit-height is measured from home", "Give ALT in --home"]),
        ((ranking, "--gimbal", 10, 5), ["LOW of --gimbal is not below HIGH of --gimbal.", help_hint]),
        ((nowhere,), ["Send images with GPS", "enu world (`fvs-client scenes create --origin`)"]),
        ((nowhere, "--format", "nerfstudio", *home), ["so --home has no meaning in it.", "Leave it out: "]),
        ((nowhere, "--format", "ros-posearray", *home), ["no metres, which ROS needs"]),
    ):
        refused = _said(run("mission", *given, expect=2 if help_hint in said else 3))
        for part in said:
            assert part in refused
        assert not re.search(r"[a-z]_[a-z]|openapi", refused.replace("(request req_", "")), refused


def test_files_that_cannot_be_written_are_errors_of_one_line(run: Run, gateway: Any, tmp_path: Path) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    snapshot = gateway.model(scene, alignment=Alignment(status=AlignmentStatus.ALIGNED, scale=10.0))
    ranking = json.loads(run("rank", scene, "--generator", "orbit", "--count", 4, "--json").stdout)["id"]
    missing, taken = tmp_path / "missing" / "next.plan", tmp_path / "taken"
    taken.write_text("a file")
    refused = run("mission", ranking, "--out", missing, expect=2)
    assert _said(refused) == f"Error: {missing}: No such file or directory.\n"
    refused = run("mission", ranking, "--out", missing, "--json", expect=2)
    assert json.loads(_said(refused))["error"]["message"] == f"{missing}: No such file or directory."
    for words in (
        ("mission", ranking, "--out", taken / "next.plan"),
        ("rank", scene, "--renders", taken),
        ("rank", scene, "--renders", taken / "below"),
        ("download", snapshot, "--out", taken),
        ("download", snapshot, "--out", taken / "below"),
        ("originals", scene, "--out", taken),
    ):
        lines = _said(run(*words, expect=2)).splitlines()
        assert lines[-1].startswith(f"Error: {taken}"), lines
    assert taken.read_text() == "a file"


def test_the_ground_may_be_that_of_the_points(run: Run, gateway: Any, tmp_path: Path) -> None:
    origin = {"latitude_deg": 46.02, "longitude_deg": 7.75, "altitude_m": 500.0}
    ground = Terrain(
        **{"south_deg": 46.01, "west_deg": 7.74, "latitude_step_deg": 0.02, "longitude_step_deg": 0.01},
        **{"columns": 3, "heights_m": (-3500.0, 500.0, 4500.0) * 2},
    )
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    aligned = Alignment(status=AlignmentStatus.ALIGNED, scale=10.0)
    gateway.model(scene, alignment=aligned, terrain=ground)
    asked = (scene, "--generator", "orbit", "--count", 12, "--terrain", "points", "--json")
    statuses = {item["id"]: item["status"] for item in json.loads(run("rank", *asked).stdout)["candidates"]}
    plan = json.loads(run("plan", *asked).stdout)
    (found,) = [one for one in plan["warnings"] if one["code"] == "under-ground"]
    assert set(found["candidates"]) == {name for name, status in statuses.items() if status == "under-ground"}
    over = ("--home", "46.02,7.75", "--terrain", "points", "--leave-out", "--out", tmp_path)
    run("mission", plan["id"], *over, "--format", "csv")
    (file,) = tmp_path.glob("*.csv")
    height_m = float(file.read_text().splitlines()[1].split(",")[5])
    stop = next(one for one in plan["tours"][0]["stops"] if one["id"] in file.read_text())
    assert height_m == pytest.approx(stop["pose"]["altitude_m"] - 500.0, abs=0.01)
    assert "There is no file dem.tif" in run("rank", scene, "--terrain", "dem.tif", expect=2).stderr
