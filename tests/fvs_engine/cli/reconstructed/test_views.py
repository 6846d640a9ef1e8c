"""Ranking, planning and rendering views of a reconstruction."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.cli.exit_codes import EXIT_CODES
from fvs_engine.errors import Cancelled
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.model import open_model
from fvs_engine.pipeline.plan import plan_next_views
from fvs_engine.plan.plan import make_plan
from fvs_engine.plan.tours import Budget

Fvs = Callable[..., Any]


def test_ranking_without_candidates(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    run = fvs("rank", first_run[0], "--top", 3, "--out", tmp_path / "ranking", "--json")
    assert run.status == 0, run.stderr
    shown = run.document["candidates"]
    assert len(shown) == 3
    everything = json.loads((tmp_path / "ranking" / "ranking.json").read_text())["candidates"]
    assert everything[:3] == shown
    scores = [place["score"] for place in everything if place["status"] == "ranked"]
    assert scores == sorted(scores)
    assert [place["rank"] for place in everything if place["status"] == "ranked"] == list(
        range(1, len(scores) + 1)
    )
    with Image.open(tmp_path / "ranking" / "contact_sheet.png") as sheet:
        assert sheet.width > 300


@pytest.mark.system
@pytest.mark.parametrize(("method", "estimated"), [("estimate", True), ("fast", False)])
def test_ranking_by_other_methods(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path, method: str, estimated: bool
) -> None:
    """So few candidates are all exact by the fast method."""
    run = fvs("rank", first_run[0], "--method", f"median-frequency-{method}", "--out", tmp_path, "--json")
    assert run.status == 0, run.stderr
    assert run.document["method"] == f"median-frequency-{method}"
    assert {place["estimated"] for place in run.document["candidates"]} == {estimated}
    text = fvs("rank", first_run[0], "--method", f"median-frequency-{method}", "--out", tmp_path)
    assert ("≈" in text.stdout) is estimated


def test_a_contact_sheet_holds_no_more_than_can_be_looked_at(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_engine.pipeline.rank.MOST_ON_SHEET", 1)
    areas = []
    for top in (1, 3):
        assert fvs("rank", first_run[0], "--top", top, "--out", tmp_path / str(top)).status == 0
        with Image.open(tmp_path / str(top) / "contact_sheet.png") as sheet:
            areas.append(sheet.size)
    assert areas[0] == areas[1]


def test_ranking_of_a_file_where_one_view_sees_nothing(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    out, run = first_run
    training = run.document["manifest"]["training"]
    known = training["test_views"][0]
    centre = np.mean([camera.projection_center() for camera in _images(out)], axis=0)
    away = {"id": "away", "pose": {"position": (centre + 1e6).tolist(), "orientation_wxyz": [1, 0, 0, 0]}}
    candidates = tmp_path / "candidates.json"
    candidates.write_text(json.dumps([away, {"id": "known", "view": known}]))
    ranked = fvs("rank", out, "--candidates", candidates, "--out", tmp_path / "ranking", "--json")
    assert ranked.status == 0, ranked.stderr
    first, last = ranked.document["candidates"]
    assert (first["name"], first["rank"], first["status"]) == ("known", 1, "ranked")
    assert (last["name"], last["rank"], last["score"], last["status"]) == ("away", None, None, "out-of-model")

    table = fvs("rank", out, "--candidates", candidates, "--out", tmp_path / "ranking")
    assert "known" in table.stdout
    assert "out-of-model" in table.stdout


def test_a_plan_of_the_next_views(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    run = fvs("plan", first_run[0], "--views", 3, "--out", tmp_path / "plan", "--json")
    assert run.status == 0, run.stderr
    written = json.loads((tmp_path / "plan" / "plan.json").read_text())
    plan = run.document["plan"]
    assert plan == written["plan"]
    (tour,) = plan["tours"]
    assert len(tour["stops"]) == 3
    assert {pose["name"] for pose in written["poses"]} == {stop["name"] for stop in tour["stops"]}
    assert len(plan["targets"]) == len(plan["target_variances"])
    assert plan["end"]["variance"] < plan["now"]["variance"]
    assert all(0 <= term["chance"] <= 1 for term in plan["terms"])  # poses are estimated
    assert all(0 < term["coverage"] <= 1 for term in plan["terms"])
    assert len({term["median_frequency"] for term in plan["terms"]}) > 1
    with Image.open(tmp_path / "plan" / "plan.png") as picture:
        assert picture.width > 1_000

    table = fvs("plan", first_run[0], "--views", 3, "--out", tmp_path / "again")
    assert written["summary"] in table.stdout
    assert all(stop["name"] in table.stdout for stop in tour["stops"])


def test_a_plan_for_two_vehicles_within_a_distance(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    out, run = first_run
    centres = [camera.projection_center().tolist() for camera in _images(out)]
    starts = [",".join(map(str, centre)) for centre in (centres[0], centres[-1])]
    targets = tmp_path / "targets.json"
    known = run.document["manifest"]["training"]["test_views"][0]
    targets.write_text(json.dumps([{"id": "front", "view": known}]))
    options = ["--start", starts[0], "--start", starts[1], "--targets", targets, "--out", tmp_path / "plan"]
    planned = fvs("plan", out, "--views", 4, *options, "--json")
    assert planned.status == 0, planned.stderr
    assert planned.document["plan"]["targets"] == ["front"]
    tours = planned.document["plan"]["tours"]
    assert [tour["start"] for tour in tours] == [pytest.approx(centres[0]), pytest.approx(centres[-1])]
    longest = max(tour["length"] for tour in tours)
    near = fvs("plan", out, "--views", 4, *options, "--home", "--distance", 1.5 * longest, "--json")
    assert all(tour["length"] <= 1.5 * longest * 1.001 for tour in near.document["plan"]["tours"])


def test_a_plan_says_which_vehicle_cannot_fly(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    out, _ = first_run
    start = _images(out)[0].projection_center()
    zone = tmp_path / "zone.json"
    zone.write_text(json.dumps({"kind": "box", "centre": start.tolist(), "size": [1e-3] * 3}))
    here, there = (",".join(map(str, at)) for at in (start, start + 0.1))
    options = ["--views", 3, "--no-fly", zone, "--out", tmp_path / "plan"]
    run = fvs("plan", out, *options, "--start", here, "--start", there, "--json")
    assert run.status == 0, run.stderr
    grounded, flying = run.document["plan"]["tours"]
    assert not grounded["stops"]
    assert len(flying["stops"]) == 3
    assert "vehicle-blocked" in [warning["code"] for warning in run.document["plan"]["warnings"]]
    said = "Vehicle 1 of 2 gets no tour: its start is in a no-fly zone."
    shown = fvs("plan", out, *options, "--start", here, "--start", there)
    assert said in " ".join(shown.stderr.split())
    alone = fvs("plan", out, *options, "--start", here)
    assert alone.status == EXIT_CODES["invalid-input"]
    assert "The start of the vehicle is in a no-fly zone" in alone.stderr


@pytest.mark.system
def test_plans_keep_names_of_any_characters(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    out, _ = first_run
    names = ["view one, 50%", "a b.jpg", "[red]x[/red]", "%20", "é/ü\\n"]
    candidates = tmp_path / "candidates, 100%.json"
    known = [image.name for image in _images(out)]
    listed = [{"id": name, "view": view} for name, view in zip(names, known, strict=False)]
    candidates.write_text(json.dumps(listed))
    options = ["--candidates", candidates, "--targets", candidates, "--views", 5]
    run = fvs("plan", out, *options, "--out", tmp_path / "a plan, 50%", "--json")
    assert run.status == 0, run.stderr
    assert run.document["plan"]["targets"] == names
    assert {term["name"] for term in run.document["plan"]["terms"]} == set(names)
    table = fvs("plan", out, *options, "--out", tmp_path / "a plan, 50%").stdout
    assert all(pose["name"] in table for pose in run.document["poses"])


@pytest.mark.system
def test_a_plan_in_a_volume_keeps_clear_of_matter_and_zones(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    out, _ = first_run
    centres = np.array([camera.projection_center() for camera in _images(out)])
    middle, extent = centres.mean(axis=0), float(np.ptp(centres, axis=0).max())
    volume, zone = tmp_path / "volume.json", tmp_path / "zone.json"
    volume.write_text(
        json.dumps({"kind": "cylinder", "base": middle.tolist(), "radius": extent, "height": extent})
    )
    options = ["--volume", volume, "--count", 40, "--views", 3, "--out", tmp_path / "plan", "--json"]
    run = fvs("plan", out, *options)
    assert run.status == 0, run.stderr
    poses = run.document["poses"]
    assert all(pose["name"].startswith("cylinder-") for pose in poses)
    offsets = np.array([pose["position"] for pose in poses]) - middle
    assert np.linalg.norm(offsets[:, :2], axis=1).max() <= extent * 1.001
    aimed = fvs("plan", out, *options, "--aim", "nearest", "--level")
    for pose in aimed.document["poses"]:
        assert pose["name"].startswith("cylinder-")
    assert aimed.document["poses"] != poses
    assert "not middle, nearest or X,Y,Z" in fvs("plan", out, *options, "--aim", "north").stderr
    assert "need a --volume" in fvs("plan", out, "--level").stderr
    zone.write_text(json.dumps({"kind": "cylinder", "base": middle.tolist(), "radius": 9e3, "height": 9e3}))
    refused = fvs("plan", out, *options, "--no-fly", zone)
    assert refused.status == EXIT_CODES["invalid-input"]
    zone.write_text('{"kind": "cylinder"}')
    assert "zone.json: The volume cannot be used" in fvs("plan", out, *options, "--no-fly", zone).stderr
    buried = fvs("plan", out, "--safety", 1e6)
    assert "candidates is feasible: " in buried.stderr
    assert "too close to matter" in buried.stderr
    assert "not both" in fvs("plan", out, "--volume", volume, "--candidates", volume).stderr


def test_plans_that_cannot_be_made_say_what_to_change(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    short = fvs("plan", first_run[0], "--distance", 1e-6)
    assert short.status == EXIT_CODES["invalid-input"]
    assert "does not reach any candidate: the nearest is" in short.stderr
    assert "Give at least" in short.stderr
    assert "none where there is no limit" in fvs("plan", first_run[0], "--distance", 0).stderr
    assert "is not X,Y,Z" in fvs("plan", first_run[0], "--start", "1,2").stderr
    assert "finite" in fvs("plan", first_run[0], "--start", "nan,0,0").stderr
    assert "at most 1e+09" in fvs("plan", first_run[0], "--start", "1e300,0,0").stderr
    few = fvs("plan", first_run[0], "--start", "1,0,0", "--vehicles", 3)
    assert "There are 1 --start for 3 --vehicles" in few.stderr
    assert "need a --volume" in fvs("plan", first_run[0], "--level").stderr
    assert "--count needs a --volume" in fvs("plan", first_run[0], "--count", 50).stderr
    nothing = fvs("plan", first_run[0], "--no-fly", tmp_path / "zone.json").stderr
    assert nothing.count("zone.json") == 1
    assert fvs("plan", tmp_path).status == EXIT_CODES["invalid-input"]
    many = tmp_path / "many.json"
    many.write_text(json.dumps([{}] * 100_001))
    for option in ("--candidates", "--targets"):
        assert "holds 100,001 poses; at most 100,000" in fvs("plan", first_run[0], option, many).stderr


def test_of_very_many_candidates_an_even_share_is_considered(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_engine.plan.plan._MOST_PRODUCTS", 8 * 5)
    run = fvs("plan", first_run[0], "--views", 2, "--out", tmp_path / "plan", "--json")
    assert "considers 5 of the" in run.stderr
    assert len(run.document["plan"]["terms"]) == 5


def test_a_forecast_measures_variances_as_its_plan_does(
    first_run: tuple[Path, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Candidates far away widen the plan's scale of distances; that of the photographs seen is the same."""
    held_out = [view.name for view in open_model(first_run[0]).held_out]
    far = {"id": "far", "pose": {"position": [500.0, 0.0, 0.0], "orientation_wxyz": [1, 0, 0, 0]}}
    file = tmp_path / "candidates.json"
    file.write_text(json.dumps([*({"id": f"c{name}", "view": name} for name in held_out), far]))
    given: list[Any] = []

    def spied(targets: Any, budget: Any, starts: Any, seen: Any, *rest: Any) -> Any:
        given.extend(seen)
        return make_plan(targets, budget, starts, seen, *rest)

    monkeypatch.setattr("fvs_engine.scene.scene_model.make_plan", spied)
    made, _ = plan_next_views(first_run[0], Budget(views=1), candidates_file=file, out=tmp_path / "plan")
    expected = [term.variance for term in made.plan.terms if term.name != "far"]
    assert held_out
    assert sorted(view.variance for view in given) == pytest.approx(sorted(expected))


def test_a_plan_is_stopped(first_run: tuple[Path, Any], tmp_path: Path) -> None:
    monitor = Monitor()
    monitor.cancel()
    with pytest.raises(Cancelled):
        plan_next_views(first_run[0], Budget(views=3), out=tmp_path / "plan", monitor=monitor)
    assert not (tmp_path / "plan").exists()


def test_bad_candidates_and_no_candidates(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    candidates = tmp_path / "candidates.json"
    candidates.write_text('[{"id": "a", "pose": {"position": [0, 0, 0], "orientation_wxyz": [2, 0, 0, 0]}}]')
    run = fvs("rank", first_run[0], "--candidates", candidates)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "candidates.json, candidate 0, pose.orientation_wxyz: its length is 2, not 1." in run.stderr


def test_candidates_of_two_sizes_cannot_be_compared(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    pose = {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]}
    camera = {"width": 64, "height": 48, "fx": 70, "fy": 70, "cx": 32, "cy": 24}
    candidates = tmp_path / "candidates.json"
    candidates.write_text(
        json.dumps([{"id": "a", "pose": pose}, {"id": "b", "pose": pose, "camera": camera}])
    )
    run = fvs("rank", first_run[0], "--candidates", candidates, "--out", tmp_path / "ranking")
    assert run.status == EXIT_CODES["invalid-input"]
    assert "64 × 48" in run.stderr
    assert "width and height of their camera" in run.stderr


def test_rendering(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    run = fvs(
        "render", first_run[0], "--views", "path", "--frames", 3, "--out", tmp_path / "frames", "--json"
    )
    assert run.status == 0, run.stderr
    files = [Path(name) for name in run.document["files"]]
    assert [path.name for path in files] == ["00000.png", "00001.png", "00002.png"]
    training = first_run[1].document["manifest"]["training"]
    for path in files:
        with Image.open(path) as image:
            assert image.size == (training["width_px"], training["height_px"])
            assert np.asarray(image).std() > 5


def test_rendered_views_are_named_like_the_photographs(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    run = fvs("render", first_run[0], "--views", "all", "--out", tmp_path / "renders", "--json")
    assert run.status == 0, run.stderr
    files = [str(Path(name).relative_to(tmp_path / "renders")) for name in run.document["files"]]
    assert files == [f"{name}.png" for name in first_run[1].document["manifest"]["cameras"]["registered"]]
    assert "more%20of%20them/f%FCr%20den%20Druck.jpg.png" in files


def _images(out: Path) -> list[Any]:
    return list(pycolmap.Reconstruction(str(out / "undistorted" / "sparse")).images.values())


def test_everything_is_in_the_coordinates_of_cameras_in_real_ones(
    fvs: Fvs, first_run: tuple[Path, Any], out: Path, tmp_path: Path
) -> None:
    """Of a model in UTM: rankings, plans, zones and starts are in UTM, and the results the same."""
    origin = np.array([448_000.0, 5_411_000.0, 300.0])
    manifest = json.loads((out / "manifest.json").read_text())
    manifest["cameras"]["origin"] = origin.tolist()
    (out / "manifest.json").write_text(json.dumps(manifest))
    poses = [camera.cam_from_world().inverse() for camera in _images(first_run[0])][:2]
    middle = np.mean([pose.translation for pose in poses], axis=0)
    found = []
    for folder, shift in ((first_run[0], np.zeros(3)), (out, origin)):
        listed = [
            {
                "position": (pose.translation + shift).tolist(),
                "orientation_wxyz": np.roll(pose.rotation.quat, 1).tolist(),
            }
            for pose in poses
        ]
        candidates, zone, here = tmp_path / "candidates.json", tmp_path / "zone.json", tmp_path / "here"
        candidates.write_text(json.dumps([{"id": str(i), "pose": pose} for i, pose in enumerate(listed)]))
        box = {"kind": "box", "centre": (middle + shift + 100).tolist(), "size": [1, 1, 1]}
        zone.write_text(json.dumps(box))
        rank = fvs("rank", folder, "--candidates", candidates, "--all", "--out", here, "--json")
        start = ",".join(map(str, (middle + shift).tolist()))
        options = ("--candidates", candidates, "--start", start, "--no-fly", zone, "--out", here, "--json")
        plan = fvs("plan", folder, *options)
        assert (rank.status, plan.status) == (0, 0), rank.stderr + plan.stderr
        assert [pose["position"] for pose in listed] == [
            pytest.approx(place["position"], abs=1e-6)
            for place in sorted(rank.document["candidates"], key=lambda place: place["name"])
        ]
        scores = [place["score"] for place in rank.document["candidates"]]
        (tour,) = plan.document["plan"]["tours"]
        stops = [stop["name"] for stop in tour["stops"]]
        at = [pose["position"] for pose in plan.document["poses"]]
        assert at == [pytest.approx(listed[int(name)]["position"], abs=1e-6) for name in stops]
        found.append((scores, stops, np.array(tour["start"]) - shift, tour["length"]))
    near, far = found
    assert near[:2] == (pytest.approx(far[0], rel=1e-4), far[1])
    np.testing.assert_allclose(far[2], near[2], atol=1e-6)
    assert far[3] == pytest.approx(near[3], rel=1e-6)
    info = fvs("info", out)
    assert "448000, 5411000, 300" in info.stdout
