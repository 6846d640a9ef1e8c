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
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from fvs_service.rankings.generators import generate
from fvs_service.rankings.scene_geometry import SceneGeometry
from PIL import Image, ImageDraw

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import level_axes
from fvs_engine.lab.baselines import create_selector
from fvs_engine.pipeline.model import open_model
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.generate import candidates_in
from fvs_engine.plan.volumes import Box
from fvs_engine.scene.scene_model import Ranking, SceneModel, Situation
from fvs_engine.scene.sparse_points import read_observations
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.render import to_pixels
from fvs_engine.views import PinholeView
from fvs_schema.candidates import AroundCurrent, Dataset, Grid, Orbit

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


def candidate_sets(model: SceneModel) -> Sets:
    """The candidates of every generator with its defaults, and the poses of all photographs."""
    cameras = tuple(view.camera_from_model.inverse() for view in model.views)
    level = level_axes(model.up)
    assert model.observations is not None
    points = model.observations.points
    corners = np.percentile(points, (5, 95), axis=0)[np.indices((2, 2, 2)).reshape(3, -1).T]
    box = corners[:, range(3), range(3)] @ level
    scene = SceneGeometry(cameras, np.median(points, axis=0), level, box.min(axis=0), box.max(axis=0))
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
        sets["in-volume"] = candidates_in(volume, 100, model.camera, up=level[:, 2], space=model.space())
    except InvalidInputError as error:
        print(f"in-volume: {error.message}")
    sets["photographs"] = own_poses(model, model.registered)
    return sets


def own_poses(model: SceneModel, views: tuple[PinholeView, ...]) -> tuple[PinholeView, ...]:
    """Candidates at the poses of photographs."""
    return tuple(
        PinholeView(f"own-{number}", model.camera, view.camera_from_model)
        for number, view in enumerate(views)
    )


def ranked(
    model: SceneModel, views: tuple[PinholeView, ...], method: str, rasterizer: Rasterizer, *, every: bool
) -> Ranking:
    """The ranking of a runner."""
    situation = Situation(budget=FIRST)
    return model.rank(views, create_selector(method), rasterizer, situation=situation, rank_all=every)


def sheet(
    path: Path,
    rows: list[tuple[str, Ranking, tuple[PinholeView, ...]]],
    model: SceneModel,
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
            page.paste(Image.fromarray(to_pixels(model.render(view, rasterizer))), at)
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
        observations = read_observations(open_model(root).workspace.undistorted / "sparse")
        model = replace(model, read_observations=partial(seen_by, observations, model.views))
        if args.half:
            sets: Sets = {"photographs": own_poses(model, model.held_out)}
        else:
            sets = candidate_sets(model)
        counts: dict[str, dict[str, int]] = {}
        for name, views in sets.items():
            statuses = Counter(
                one.status.value
                for one in ranked(model, views, "nearest", rasterizer, every=False).candidates
            )
            counts[name] = dict(statuses)
            print(f"{root.name:12} {name:15} {dict(statuses)}", flush=True)
        table[root.name] = counts
        for every in () if args.half else (True, False):
            rows = []
            for name, views in sets.items():
                for method in METHODS:
                    ranking = ranked(model, views, method, rasterizer, every=every)
                    rows.append((f"{name} {method}", ranking, views))
            sheet(args.out / f"{root.name}{'-all' if every else ''}.png", rows, model, rasterizer)
    (args.out / "first_views.json").write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
