"""The program on real photographs, from start to end; small enough to run every time."""

import json
import os
import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from fvs_engine.cli.exit_codes import EXIT_CODES
from fvs_engine.errors import Cancelled
from fvs_engine.sfm import stages
from fvs_engine.splat.ply import read_ply

pytestmark = pytest.mark.usefixtures("all_native_here")

Fvs = Callable[..., Any]
FvsUntil = Callable[..., tuple[int, str]]
FvsCommand = Callable[..., list[str]]
OPTIONS = ("--iterations", 120, "--long-side", 240, "--test-every", 5)


@pytest.fixture(scope="module")
def photographs(kermit_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Kermit at half its size, as a careless user hands it over: files of every kind, some of them bad."""
    folder, halved = tmp_path_factory.mktemp("photographs"), tmp_path_factory.mktemp("halved")
    for path in kermit_dir.iterdir():
        with Image.open(path) as image:
            image.resize((320, 240)).save(halved / path.name, quality=95, exif=image.getexif())
    good = sorted(halved.iterdir())
    for path in good[:6]:
        shutil.copyfile(path, folder / path.name)
    (folder / "more of them").mkdir()
    with Image.open(good[6]) as image:
        exif = Image.Exif()
        exif[0x0112] = 6
        image.transpose(Image.Transpose.ROTATE_90).save(
            folder / "more of them" / "held upright.jpg", quality=95, exif=exif
        )
    with Image.open(good[7]) as image:
        image.convert("CMYK").save(folder / "more of them" / "für den Druck.jpg", quality=95)
    with Image.open(good[8]) as image:
        opaque = image.convert("RGBA")
        opaque.save(folder / "alpha.png")
    with Image.open(good[9]) as image:
        grey = np.asarray(image.convert("L"), dtype=np.uint16) * 257
        Image.fromarray(grey).save(folder / "sixteen bits.tif")
    with Image.open(good[10]) as image:
        image.resize((240, 180), Image.Resampling.LANCZOS).save(folder / "smaller.jpg", quality=95)
    shutil.copyfile(good[0], folder / "the first again.jpg")
    (folder / "cut off.jpg").write_bytes(good[1].read_bytes()[:10_000])
    (folder / "letter.jpg").write_text("Dear reader")
    (folder / "notes.txt").write_text("not a photograph, and not called one")
    return folder


@pytest.fixture(scope="module")
def first_run(fvs: Fvs, photographs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The output folder of one reconstruction, and how its run ended. Not to be changed."""
    out = tmp_path_factory.mktemp("results") / "out"
    return out, fvs("reconstruct", photographs, "--out", out, "--json", *OPTIONS)


@pytest.fixture
def out(first_run: tuple[Path, Any], tmp_path: Path) -> Path:
    """A copy of the result that the test may change."""
    shutil.copytree(first_run[0], tmp_path / "out")
    return tmp_path / "out"


def test_good_photographs_are_used_and_bad_ones_are_named(first_run: tuple[Path, Any]) -> None:
    _, run = first_run
    assert run.status == 0, run.stderr
    images = run.document["manifest"]["images"]
    assert len(images["photographs"]) == 11
    reasons = {image["name"]: image["reason"] for image in images["rejected"]}
    assert set(reasons) == {"the first again.jpg", "cut off.jpg", "letter.jpg"}
    messages = [json.loads(line).get("message", "") for line in run.stderr.splitlines()]
    for name, reason in reasons.items():
        assert any(name in message and reason in message for message in messages)


def test_the_photographs_are_registered_and_learned(first_run: tuple[Path, Any]) -> None:
    out, run = first_run
    info = run.document
    cameras = info["manifest"]["cameras"]
    assert len(cameras["registered"]) >= 9
    assert info["stage"] == "finished"
    assert info["metrics"]["iterations"] == 120
    # A black image of these photographs has about 8 dB, their mean colour about 11 dB.
    assert info["metrics"]["psnr_db"] > 13
    assert len(read_ply(out / "splat" / "point_cloud.ply")) == info["metrics"]["gaussians"]


def test_others_can_open_the_undistorted_model(first_run: tuple[Path, Any]) -> None:
    out, run = first_run
    model = pycolmap.Reconstruction(str(out / "undistorted" / "sparse"))
    registered = run.document["manifest"]["cameras"]["registered"]
    assert sorted(image.name for image in model.images.values()) == registered
    for image in model.images.values():
        with Image.open(out / "undistorted" / "images" / image.name) as pixels:
            camera = model.cameras[image.camera_id]
            assert pixels.size == (camera.width, camera.height)
            assert camera.model.name == "PINHOLE"


def test_the_same_command_again_does_nothing(fvs: Fvs, photographs: Path, out: Path) -> None:
    before = (out / "splat" / "point_cloud.ply").stat().st_mtime_ns
    run = fvs("reconstruct", photographs, "--out", out, *OPTIONS)
    assert run.status == 0
    assert "Nothing to do" in run.stderr
    assert (out / "splat" / "point_cloud.ply").stat().st_mtime_ns == before


def test_more_iterations_go_on(fvs: Fvs, photographs: Path, out: Path) -> None:
    run = fvs("reconstruct", photographs, "--out", out, "--json", "--iterations", 140, *OPTIONS[2:])
    assert run.status == 0
    assert run.document["metrics"]["iterations"] == 140
    reports = [json.loads(line) for line in run.stderr.splitlines()]
    trained = [report["done"] for report in reports if report.get("stage") == "train"]
    assert min(trained) > 120
    assert not any(report.get("stage") == "features" for report in reports)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--iterations", 120, "--long-side", 240, "--test-every", 4), "test_every was 5 and is 4"),
        ((*OPTIONS, "--seed", 3), "seed was 0 and is 3"),
        ((*OPTIONS, "--quality", "fine"), "quality was coarse and is fine"),
        ((*OPTIONS, "--camera-model", "OPENCV"), "camera_model was the default and is OPENCV"),
    ],
)
def test_other_settings_are_not_mixed_in(
    fvs: Fvs, photographs: Path, first_run: tuple[Path, Any], options: tuple[Any, ...], message: str
) -> None:
    run = fvs("reconstruct", photographs, "--out", first_run[0], *options)
    assert run.status == EXIT_CODES["output-exists"]
    assert message in run.stderr
    assert "--overwrite" in run.stderr


def test_other_photographs_are_not_mixed_in(fvs: Fvs, kermit_dir: Path, first_run: tuple[Path, Any]) -> None:
    run = fvs("reconstruct", kermit_dir, "--out", first_run[0], *OPTIONS)
    assert run.status == EXIT_CODES["output-exists"]
    assert "photographs are new" in run.stderr
    assert "are gone" in run.stderr


def forget_training(out: Path) -> None:
    shutil.rmtree(out / "splat")
    (out / "metrics.json").unlink()
    manifest = json.loads((out / "manifest.json").read_text())
    manifest["training"] = None
    (out / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.slow  # half a minute; test_select.py has a shorter one
def test_ctrl_c_leaves_a_state_that_resumes_to_the_same_result(
    fvs_command: FvsCommand, fvs_until: FvsUntil, photographs: Path, out: Path
) -> None:
    # Gaussians are added up to iteration 1,000, by what was learned in the hundred iterations before.
    iterations, last_added_at = 2_000, 1_000
    arguments = ("reconstruct", photographs, "--out", out, "--iterations", iterations, *OPTIONS[2:])
    point_cloud = out / "splat" / "point_cloud.ply"
    forget_training(out)
    subprocess.run(fvs_command(*arguments), check=True, capture_output=True)
    uninterrupted = point_cloud.read_bytes()
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["training"]["gaussians"] > manifest["cameras"]["points"]

    forget_training(out)
    status, rest = fvs_until(
        *arguments,
        wanted=lambda report: report.get("stage") == "train" and report["done"] >= 20,
        number=signal.SIGINT,
    )
    assert status == EXIT_CODES["cancelled"]
    assert "Run the same command again to resume." in rest
    stopped = json.loads((out / "manifest.json").read_text())["training"]["iterations"]
    assert 20 <= stopped < last_added_at

    subprocess.run(fvs_command(*arguments), check=True, capture_output=True)
    assert point_cloud.read_bytes() == uninterrupted


def test_cameras_can_come_from_a_colmap_model(
    fvs: Fvs, photographs: Path, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    options = ("--colmap", first_run[0] / "sfm" / "sparse", "--iterations", 2, "--long-side", 240, "--json")
    run = fvs("reconstruct", photographs, "--out", tmp_path / "out", *options)
    assert run.status == 0, run.stderr
    before, after = (document["manifest"]["cameras"] for document in (first_run[1].document, run.document))
    assert after["source"] == "colmap"
    assert after["registered"] == before["registered"]
    assert after["points"] == before["points"]
    centres = [
        {image.name: image.projection_center() for image in _images(out)}
        for out in (first_run[0], tmp_path / "out")
    ]
    for name, centre in centres[0].items():
        np.testing.assert_allclose(centres[1][name], centre, atol=1e-9)


def test_known_intrinsics_are_kept_and_remembered(fvs: Fvs, kermit_copy: Path, tmp_path: Path) -> None:
    for path in sorted(kermit_copy.iterdir())[4:]:
        path.unlink()
    file = tmp_path / "cameras.txt"
    file.write_text("# of the photographs at twice their size\n1 PINHOLE 1280 960 1389 1389 640 480\n")
    arguments = ("reconstruct", kermit_copy, "--out", tmp_path / "out", "--iterations", 2, "--long-side", 240)
    run = fvs(*arguments, "--intrinsics", file, "--json")
    assert run.status == 0, run.stderr
    assert run.document["manifest"]["settings"]["intrinsics"]["model"] == "PINHOLE"
    model = pycolmap.Reconstruction(str(tmp_path / "out" / "sfm" / "sparse"))
    assert [camera.params.tolist() for camera in model.cameras.values()] == [[694.5, 694.5, 320.0, 240.0]]

    again = fvs(*arguments, "--intrinsics", file)
    assert again.status == 0
    assert "Nothing to do" in again.stderr
    file.write_text("1 PINHOLE 1280 960 1400 1400 640 480\n")
    other = fvs(*arguments, "--intrinsics", file)
    assert other.status == EXIT_CODES["output-exists"]
    assert "intrinsics was PINHOLE (1389, 1389, 640, 480)" in other.stderr


def test_a_colmap_model_of_other_photographs_is_refused(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    for index in range(3):
        pixels = np.random.default_rng(index).integers(0, 256, (60, 80, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / f"holiday {index}.png")
    colmap = first_run[0] / "sfm" / "sparse"
    run = fvs("reconstruct", tmp_path, "--out", tmp_path / "out", "--colmap", colmap)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "holiday 0.png" in run.stderr
    assert "these cameras were computed from" in run.stderr


def test_overwrite_starts_again(
    fvs: Fvs, kermit_dir: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to the first stage; that it clears the folder is what matters here."""
    (out / "mine.txt").write_text("stays")

    def cancelled(*_: object, **__: object) -> None:
        raise Cancelled("Stopped on request.")

    monkeypatch.setattr(stages, "run_native", cancelled)
    run = fvs("reconstruct", kermit_dir, "--out", out, "--overwrite")
    assert run.status == EXIT_CODES["cancelled"]
    assert (out / "mine.txt").read_text() == "stays"
    assert not (out / "splat").exists()
    assert not (out / "metrics.json").exists()
    run = fvs("info", out, "--json")
    assert run.document["stage"] == "structure from motion is not finished"


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
    away = {"name": "away", "position": (centre + 1e6).tolist(), "orientation_wxyz": [1, 0, 0, 0]}
    candidates = tmp_path / "candidates.json"
    candidates.write_text(json.dumps([away, {"name": "known", "view": known}]))
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
    mission = run.document["mission"]
    assert mission == written["mission"]
    (tour,) = mission["tours"]
    assert len(tour["stops"]) == 3
    assert {pose["name"] for pose in written["poses"]} == {stop["name"] for stop in tour["stops"]}
    assert len(written["targets"]) == len(mission["target_variances"])
    assert mission["end"]["variance"] < mission["now"]["variance"]
    assert all(0 <= term["chance"] <= 1 for term in mission["terms"])  # poses are estimated
    assert all(0 < term["coverage"] <= 1 for term in mission["terms"])
    assert len({term["median_frequency"] for term in mission["terms"]}) > 1
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
    targets.write_text(json.dumps([{"name": "front", "view": known}]))
    options = ["--start", starts[0], "--start", starts[1], "--targets", targets, "--out", tmp_path / "plan"]
    planned = fvs("plan", out, "--views", 4, *options, "--json")
    assert planned.status == 0, planned.stderr
    assert planned.document["targets"] == ["front"]
    tours = planned.document["mission"]["tours"]
    assert [tour["start"] for tour in tours] == [pytest.approx(centres[0]), pytest.approx(centres[-1])]
    longest = max(tour["length"] for tour in tours)
    near = fvs("plan", out, "--views", 4, *options, "--home", "--distance", 1.5 * longest, "--json")
    assert all(tour["length"] <= 1.5 * longest * 1.001 for tour in near.document["mission"]["tours"])


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
    assert "Something is in the way" in buried.stderr
    assert "not both" in fvs("plan", out, "--volume", volume, "--candidates", volume).stderr


def test_plans_that_cannot_be_made_say_what_to_change(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    short = fvs("plan", first_run[0], "--distance", 1e-6)
    assert short.status == EXIT_CODES["invalid-input"]
    assert "does not reach any candidate: the nearest is" in short.stderr
    assert "Give at least" in short.stderr
    assert "is not X,Y,Z" in fvs("plan", first_run[0], "--start", "1,2").stderr
    assert "finite" in fvs("plan", first_run[0], "--start", "nan,0,0").stderr
    assert fvs("plan", tmp_path).status == EXIT_CODES["invalid-input"]


def test_bad_candidates_and_no_candidates(fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path) -> None:
    candidates = tmp_path / "candidates.json"
    candidates.write_text('[{"name": "a", "position": [0, 0, 0], "orientation_wxyz": [2, 0, 0, 0]}]')
    run = fvs("rank", first_run[0], "--candidates", candidates)
    assert run.status == EXIT_CODES["invalid-input"]
    assert "candidates.json, candidate 0, orientation_wxyz: its length is 2, not 1." in run.stderr


def test_candidates_of_two_sizes_cannot_be_compared(
    fvs: Fvs, first_run: tuple[Path, Any], tmp_path: Path
) -> None:
    pose = {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]}
    camera = {"width": 64, "height": 48, "fx": 70, "fy": 70, "cx": 32, "cy": 24}
    candidates = tmp_path / "candidates.json"
    candidates.write_text(json.dumps([{"name": "a", **pose}, {"name": "b", **pose, "camera": camera}]))
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
    assert "more%20of%20them/für%20den%20Druck.jpg.png" in files


def test_info_for_people(fvs: Fvs, first_run: tuple[Path, Any]) -> None:
    run = fvs("info", first_run[0])
    assert run.status == 0
    for fragment in ("11 used, 3 left out", "registered", "120 of 120", "PSNR"):
        assert fragment in run.stdout


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_reader_that_left_ends_the_program_quietly(
    fvs_command: FvsCommand, first_run: tuple[Path, Any], options: tuple[str, ...]
) -> None:
    reading_end, writing_end = os.pipe()
    os.close(reading_end)
    try:
        command = fvs_command("info", first_run[0], *options)
        run = subprocess.run(command, stdout=writing_end, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(writing_end)
    assert run.returncode == -signal.SIGPIPE
    assert run.stderr == ""


def test_lines_are_whole_where_there_is_no_terminal(fvs: Fvs, first_run: tuple[Path, Any]) -> None:
    (training,) = [line for line in fvs("info", first_run[0]).stdout.splitlines() if "training" in line]
    assert "iterations/s" in training


def _images(out: Path) -> list[Any]:
    return list(pycolmap.Reconstruction(str(out / "undistorted" / "sparse")).images.values())
