"""The first ten candidates of rankings, with and without feasibility: contact sheets to look at, and counts.

    python benchmarks/first_views.py MODEL … [--half] [--out first_views]

MODEL: output folders of `fvs reconstruct`. Candidates are those of every generator of the service, and the
poses of the photographs themselves. They are ranked as the service ranks them, by three methods, and written
to OUT/MODEL-all.png (``rank_all``) and OUT/MODEL.png, a row for each set and method.

With --half only the poses of half of the photographs are ranked, by models of the others beside them,
MODEL-half, and by what these photographs saw: none should lose its rank. They are made by `fvs reconstruct
PHOTOGRAPHS --colmap MODEL/sfm/sparse --test-every 2 --out MODEL-half`.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np
from fvs_service.host.runner.model_states import ModelState
from fvs_service.host.runner.ranking import rank_views
from fvs_service.rankings.generators import generate
from fvs_service.rankings.model import AroundCurrent, Dataset, Grid, Orbit
from fvs_service.rankings.port import RankedViews, RankViews
from fvs_service.rankings.scene_geometry import SceneGeometry
from fvs_service.snapshots.model import PinholeIntrinsics, SnapshotCameras, SnapshotView
from PIL import Image, ImageDraw

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import level_axes, quaternion_from_matrix
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.model import TrainedModel, open_model
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.generate import candidates_in
from fvs_engine.plan.volumes import Box
from fvs_engine.scene.observations import read_observations
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.render import render_color, to_pixels
from fvs_engine.views import PinholeView

METHODS = ("median-frequency", "fisher", "kriging")
FIRST = 10
TILE_PX = 150

Sets = dict[str, tuple[PinholeView, ...]]


def seen_by(observations: Observations, photographs: tuple[PinholeView, ...]) -> Observations:
    """The points that at least two of ``photographs`` saw, and these observations."""
    centres = np.stack([view.centre for view in photographs])
    distances = np.linalg.norm(observations.seen_from[:, None] - centres, axis=2).min(axis=1)
    kept = distances < 1e-6 * np.ptp(centres, axis=0).max()
    points = observations.observed_point[kept]
    often = np.bincount(points, minlength=len(observations.points))[points] >= 2
    return Observations(observations.points, points[often], observations.seen_from[kept][often])


def candidate_sets(model: TrainedModel, state: ModelState) -> Sets:
    """The candidates of every generator with its defaults, and the poses of all photographs."""
    cameras = tuple(view.camera_from_model.inverse() for view in model.training_views)
    level = level_axes(np.array(state.cameras.up))
    corners = np.array([state.cameras.lower, state.cameras.upper])[np.indices((2, 2, 2)).reshape(3, -1).T]
    box = corners[:, range(3), range(3)] @ level
    scene = SceneGeometry(cameras, np.array(state.cameras.centre), level, box.min(axis=0), box.max(axis=0))
    spread = float(np.linalg.norm(np.std(scene.centres, axis=0)))
    current = cameras[-1].translation
    made = {
        "orbit": generate(Orbit(kind="orbit"), scene, None, None),
        "grid": generate(Grid(kind="grid"), scene, None, None),
        "dataset": generate(Dataset(kind="dataset"), scene, None, None),
        "around-current": generate(AroundCurrent(kind="around-current"), scene, current, spread),
    }
    sets = {
        name: tuple(PinholeView(one, model.camera, pose.inverse()) for one, pose in poses.items())
        for name, poses in made.items()
    }
    around = np.concatenate([scene.centres @ level, box])
    low, high = around.min(axis=0), around.max(axis=0)
    volume = Box(
        centre=tuple((level @ (0.5 * (low + high))).tolist()),
        size=tuple((high - low).tolist()),
        up=tuple(level[:, 2].tolist()),
        along=tuple(level[:, 0].tolist()),
    )
    try:
        sets["in-volume"] = candidates_in(
            volume, 100, model.camera, up=level[:, 2], space=FreeSpace(state.matter)
        )
    except InvalidInputError as error:
        print(f"in-volume: {error.message}")
    sets["photographs"] = own_poses(model, model.views)
    return sets


def own_poses(model: TrainedModel, views: tuple[PinholeView, ...]) -> tuple[PinholeView, ...]:
    """Candidates at the poses of photographs."""
    return tuple(
        PinholeView(f"own-{number}", model.camera, view.camera_from_model)
        for number, view in enumerate(views)
    )


def state_of(model: TrainedModel, observations: Observations) -> ModelState:
    """The model as a runner holds it."""
    poses = [view.camera_from_model.inverse() for view in model.training_views]
    up = -np.mean([pose.rotation[:, 1] for pose in poses], axis=0)
    low, high = np.percentile(observations.points, (5, 95), axis=0)
    cameras = SnapshotCameras(
        camera=PinholeIntrinsics.of(model.camera),
        views=tuple(
            SnapshotView(
                image=f"sha256:{number:064x}",
                name=f"{number}",
                position=tuple(pose.translation.tolist()),
                orientation_wxyz=tuple(quaternion_from_matrix(pose.rotation).tolist()),
            )
            for number, pose in enumerate(poses)
        ),
        centre=tuple(np.median(observations.points, axis=0).tolist()),
        up=tuple((up / np.linalg.norm(up)).tolist()),
        lower=tuple(low.tolist()),
        upper=tuple(high.tolist()),
    )
    gaussians = model.gaussians
    iterations = model.training.iterations
    return ModelState("model", gaussians, gaussians.sh_degree, cameras, iterations, lambda: observations)


def ranked(
    state: ModelState, views: tuple[PinholeView, ...], method: str, rasterizer: Rasterizer, *, every: bool
) -> RankedViews:
    """The ranking of a runner."""
    request = RankViews(
        scene_id="scene", snapshot_id="model", method=method, views=views, rank_all=every, budget=FIRST
    )
    return rank_views(request, state, rasterizer, Monitor())


def sheet(
    path: Path,
    rows: list[tuple[str, RankedViews, tuple[PinholeView, ...]]],
    state: ModelState,
    rasterizer: Rasterizer,
) -> None:
    """Write the first ten renders of every ranking, a row each."""
    camera = rows[0][2][0].camera
    scale = TILE_PX / max(camera.width, camera.height)
    small = camera.resized(round(scale * camera.width), round(scale * camera.height))
    height, margin = small.height + 14, 110
    page = Image.new("RGB", (margin + FIRST * (TILE_PX + 4), height * len(rows)), "white")
    draw = ImageDraw.Draw(page)
    for row, (title, ranking, views) in enumerate(rows):
        draw.text((2, row * height + height // 3), title.replace(" ", "\n"), fill="black")
        by_name = {view.name: view for view in views}
        first = [one for one in ranking.candidates if one.rank is not None][:FIRST]
        for column, one in enumerate(first):
            view = PinholeView(one.name, small, by_name[one.name].camera_from_model)
            at = (margin + column * (TILE_PX + 4), row * height)
            page.paste(Image.fromarray(to_pixels(render_color(state.gaussians, view, rasterizer))), at)
            chance = "" if one.chance is None else f"{one.chance:.2f}"
            draw.text((at[0], at[1] + small.height), f"{one.score:.3g} {one.status} {chance}", fill="black")
    page.save(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--half", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("first_views"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    rasterizer = create_rasterizer("cpu")
    table = {}
    for root in args.models:
        model = open_model(root.with_name(f"{root.name}-half") if args.half else root)
        observations = seen_by(
            read_observations(open_model(root).workspace.undistorted / "sparse"), model.training_views
        )
        state = state_of(model, observations)
        if args.half:
            sets: Sets = {"photographs": own_poses(model, model.held_out_views)}
        else:
            sets = candidate_sets(model, state)
        counts: dict[str, dict[str, int]] = {}
        for name, views in sets.items():
            statuses = Counter(
                one.status.value
                for one in ranked(state, views, "nearest", rasterizer, every=False).candidates
            )
            counts[name] = dict(statuses)
            print(f"{root.name:12} {name:15} {dict(statuses)}", flush=True)
        table[root.name] = counts
        for every in () if args.half else (True, False):
            rows = []
            for name, views in sets.items():
                for method in METHODS:
                    ranking = ranked(state, views, method, rasterizer, every=every)
                    rows.append((f"{name} {method}", ranking, views))
            sheet(args.out / f"{root.name}{'-all' if every else ''}.png", rows, state, rasterizer)
    (args.out / "first_views.json").write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
