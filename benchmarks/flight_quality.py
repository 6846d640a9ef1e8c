"""Flown distance and quality of the model: flights of 30 photographs, by several methods of ranking.

python benchmarks/flight_quality.py OUT                    over the made-up courtyard
python benchmarks/flight_quality.py OUT --replay RUN       in a model of real photographs

The vehicle has GPS errors and wind. Each flight is one of ``fvs-client fly``: a survey of 8 photographs, then
ranking, mission, photograph, spool and update. Afterwards every model that the service made is moved to the
true frame, by the true poses of its photographs, and compared with the world at poses that nobody flew to. A
flight whose result is in OUT is not flown again.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from flights import FIELD, HOME, WORLD, Truth, copter, read_truth
from fvs_client import Candidate, Client, Orbit, Scene
from fvs_client.fly.flight import Flight, FlightSettings
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from fvs_service.serving.running import running_service
from matplotlib.figure import Figure
from measurement import machine
from PIL import Image
from rich.console import Console
from rich.table import Table

from fvs_engine.geometry import (
    PinholeCamera,
    RigidTransform,
    SimilarityTransform,
    look_at,
    matrix_from_quaternion,
)
from fvs_engine.geometry.alignment.cameras import align_poses
from fvs_engine.images.pixels import reduced_size
from fvs_engine.lab.simulate import SimulatedCamera, courtyard
from fvs_engine.lab.simulate.replay import open_replay, write_poses
from fvs_engine.lab.simulate.scenery import MadeUpScenery, Scenery
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.ply import read_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.views import PinholeView

SPEED_UP = 20
RADIUS_M, HEIGHT_M, TARGET_M = 30.0, 13.0, 5.0
REACH_M, REPLAY_REACH_M = 18.0, 12.0
"""Views farther than this from the one before share too little with it to be registered."""
ARC_DEG, REPLAY_ARC_DEG = 100.0, 60.0
"""Of the survey: real things hide one another more than the courtyard's boxes do."""
HELD_OUT = 24
MOST_VIEWS = 110
"""Photographs of a replay world that are used: every fifth is held out, the others are candidates."""
SIZE = (480, 360)
LONG_SIDE_PX, ITERATIONS = 240, 300
console = Console()


class Site:
    """A world, the survey and the candidates of its flights, and photographs that no flight takes."""

    def __init__(self, replay: Path | None, seed: int) -> None:
        start_deg = 360.0 * seed / 7
        self.reach_m, arc_deg = (REACH_M, ARC_DEG) if replay is None else (REPLAY_REACH_M, REPLAY_ARC_DEG)
        if replay is None:
            self.arguments = ["--size", *map(str, SIZE)]
            width, height = SIZE
            focal = 0.65 * width
            pinhole = PinholeCamera(width, height, focal, focal, width / 2, height / 2)
            scenery: Scenery = MadeUpScenery(courtyard(seed), pinhole, scale=10.0)
            middle, target, vignetting = HEIGHT_M, TARGET_M, 0.15
            self.candidates: tuple[Candidate, ...] | None = None
            self.held_out = _around_the_courtyard(seed)
        else:
            self.arguments = ["--replay", str(replay)]
            scenery = replayed = open_replay(replay)
            views = [replayed.views[index] for index in _even(len(replayed.views), MOST_VIEWS)]
            middle = float(np.median([view.centre[2] for view in views]))
            target, vignetting, pinhole = replayed.target_height_m, 0.0, replayed.camera
            self.held_out = [view.camera_from_model.inverse() for view in views[::5]]
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, "poses.json")
                write_poses(path, [view for number, view in enumerate(views) if number % 5], HOME)
                self.candidates = tuple(map(Candidate.model_validate, json.loads(path.read_text())))
        self.arguments += ["--seed", str(seed), "--speed-up", str(SPEED_UP), "--endurance", "90000", *FIELD]
        home = (HOME.latitude_deg, HOME.longitude_deg)
        self.survey = Survey(*home, RADIUS_M, middle, target, 8, start_deg, arc_deg)
        self.camera = pinhole.resized(*reduced_size(pinhole.width, pinhole.height, LONG_SIDE_PX))
        still = SimulatedCamera(scenery.camera, vignetting=vignetting, full_well=None, read_noise=0.0)
        self.photographs = [
            _reduced(still.develop(scenery.light(pose), 0), self.camera) for pose in self.held_out
        ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--replay", type=Path, help="an output folder of `fvs reconstruct`")
    parser.add_argument("--methods", nargs="+", default=["median-frequency", "kriging"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--views", type=int, default=30)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for seed in options.seeds:
        site: Site | None = None
        for method in options.methods:
            path = options.out / f"{method}-{seed}.json"
            if not path.exists():
                site = site or Site(options.replay, seed)
                path.write_text(json.dumps(_flown(site, method, seed, options), indent=1))
            results.append(json.loads(path.read_text()))
    _draw(options.out / "flight_quality.png", results)
    _show(results, options.methods)


def _flown(site: Site, method: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Fly once; returns what each of the service's models is worth."""
    began = time.monotonic()
    log = options.out / f"{method}-{seed}.jsonl"
    log.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="fvs-flight-") as name:
        folder = Path(name)
        camera, truth = folder / "camera", folder / "truth.jsonl"
        arguments = [*site.arguments, "--truth", str(truth)]
        with (
            running_service(folder / "service", options.out / "service.log") as service,
            copter(camera, options.out / "copter.log", arguments) as url,
            Client(service.url) as client,
        ):
            scene = client.scenes.create("flight", world=WORLD)
            settings = FlightSettings(
                vehicle="copter",
                photographs=options.views,
                method=method,
                generator=Orbit(count=48, radius_m=RADIUS_M) if site.candidates is None else None,
                candidates=site.candidates,
                radius_m=site.reach_m,
                survey=site.survey,
                patience_s=6_000.0,
                iterations=ITERATIONS,
                long_side_px=LONG_SIDE_PX,
                mission={"lowest_height_m": 3.0, "highest_height_m": 60.0},
            )
            sending = Photographs(camera, scene.id, url=service.url, api_key=None, say=lambda _line: None)
            with Vehicle(url) as vehicle, sending as photographs:
                result = Flight(scene, vehicle, photographs, settings, FlightLog(log, console.print)).fly()
            models = _measured(site, client, scene, read_truth(truth), folder)
    return {
        "method": method,
        "seed": seed,
        "ending": result.ending.value,
        "photographs": result.photographs,
        "failed": result.failed,
        "seconds": time.monotonic() - began,
        "models": models,
        "machine": machine(),
    }


def _measured(
    site: Site, client: Client, scene: Scene, truth: Sequence[Truth], folder: Path
) -> list[dict[str, Any]]:
    """Each model of the scene: how far was flown for it, and its PSNR at the poses that nobody flew to."""
    taken = {told.file: told for told in truth}
    rasterizer = create_rasterizer("cpu")
    found = []
    for snapshot in client.scenes.get(scene.id).snapshots.list():
        gaussians = read_ply(snapshot.download("point_cloud.ply", folder / f"{snapshot.id}.ply"))
        poses = {view.name: _pose(view.position, view.orientation_wxyz) for view in snapshot.cameras().views}
        report = align_poses({name: told.world_from_camera for name, told in taken.items()}, poses)
        renders = [
            render_color(gaussians, _seen_from(report.transform, pose, site.camera), rasterizer)
            for pose in site.held_out
        ]
        scores = [psnr(*pair) for pair in zip(renders, site.photographs, strict=True)]
        photographs = snapshot.metrics.registered + snapshot.metrics.unregistered
        found.append(
            {
                "registered": len(poses),
                "photographs": photographs,
                "flown_m": truth[photographs].flown_m,  # the first is the test photograph
                "psnr_db": float(np.mean(scores)),
                "worst_db": float(np.min(scores)),
                "alignment_rms": report.rms / report.transform.scale,
                "gaussians": len(gaussians),
                "iterations": snapshot.metrics.iterations,
            }
        )
    # Of an update that made more than one model, the last counts, which was trained for longest.
    last = {model["photographs"]: model for model in sorted(found, key=lambda model: model["iterations"])}
    return [last[photographs] for photographs in sorted(last)]


def _seen_from(
    model_from_world: SimilarityTransform, world_from_camera: RigidTransform, camera: PinholeCamera
) -> PinholeView:
    return PinholeView("held-out", camera, model_from_world.move_camera(world_from_camera).inverse())


def _pose(position: Sequence[float], orientation_wxyz: Sequence[float]) -> RigidTransform:
    return RigidTransform(matrix_from_quaternion(orientation_wxyz), np.asarray(position))


def _around_the_courtyard(seed: int) -> list[RigidTransform]:
    """Poses all around, at other distances and heights than the candidates', that look at the middle."""
    generator = np.random.default_rng(seed)
    poses = []
    for number in range(HELD_OUT):
        angle = 2.0 * np.pi * (number + generator.random()) / HELD_OUT
        radius, height = RADIUS_M * generator.uniform(0.75, 1.1), HEIGHT_M * generator.uniform(0.7, 1.3)
        centre = [radius * np.cos(angle), radius * np.sin(angle), height]
        poses.append(look_at(centre, [0.0, 0.0, TARGET_M], [0.0, 0.0, 1.0]))
    return poses


def _even(count: int, most: int) -> list[int]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def _reduced(pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """A photograph [H, W, 3] in [0, 1] of the size that the service trains on."""
    image = Image.fromarray(pixels).resize((camera.width, camera.height), Image.Resampling.BOX)
    return np.asarray(image) / 255.0


def _draw(path: Path, results: Sequence[dict[str, Any]]) -> None:
    figure = Figure(figsize=(11.0, 4.5), layout="constrained")
    by_distance, by_count = figure.subplots(1, 2, sharey=True)
    methods = list(dict.fromkeys(result["method"] for result in results))
    for result in results:
        models, color = result["models"], f"C{methods.index(result['method'])}"
        label = result["method"] if result["seed"] == min(r["seed"] for r in results) else None
        worth = [model["psnr_db"] for model in models]
        by_distance.plot([m["flown_m"] for m in models], worth, ".-", color=color, label=label, alpha=0.8)
        by_count.plot([m["photographs"] for m in models], worth, ".-", color=color, alpha=0.8)
    by_distance.set(xlabel="flown, m", ylabel="PSNR at held-out poses, dB")
    by_count.set(xlabel="photographs")
    by_distance.legend()
    figure.savefig(path, dpi=110)


def _show(results: Sequence[dict[str, Any]], methods: Sequence[str]) -> None:
    table = Table("method", "seed", "ending", "registered", "flown, m", "first, dB", "last, dB", "s")
    for result in results:
        models = result["models"]
        if not models:
            table.add_row(result["method"], str(result["seed"]), result["ending"], *["none"] * 4)
            continue
        table.add_row(
            result["method"],
            str(result["seed"]),
            result["ending"],
            f"{models[-1]['registered']} of {result['photographs']}",
            f"{models[-1]['flown_m']:.0f}",
            f"{models[0]['psnr_db']:.2f}",
            f"{models[-1]['psnr_db']:.2f}",
            f"{result['seconds']:.0f}",
        )
    console.print(table)
    for method in methods:
        flights = [result["models"] for result in results if result["method"] == method and result["models"]]
        longest = min(models[-1]["flown_m"] for models in flights)
        for share in (0.25, 0.5, 0.75, 1.0):
            at_m = share * longest
            worth = [
                float(np.interp(at_m, [m["flown_m"] for m in models], [m["psnr_db"] for m in models]))
                for models in flights
            ]
            console.print(f"{method}: {np.mean(worth):.2f} dB after {at_m:.0f} m")


if __name__ == "__main__":
    main()
