"""Rankings that render few candidates, compared with exact ones: first candidates and times.

    python benchmarks/rank_fast.py [MODEL …] [--count 300] [--first 10] [--seed 0] [--processor-time]
                                   [--json rank_fast.json]

MODEL: output folders of `fvs reconstruct`; without one, a room made of 100,000 splats. Candidates of a model
are poses between and beside neighbouring views, drawn by the seed, and three rings around the point that the
views look at. Per set: Spearman's ρ of the estimates, how many views were rendered, how many of the first
ones are right, and the times of all three ways.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from measurement import report
from room import candidates as room_candidates
from room import scene as room
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import spearmanr

from fvs_engine.candidates import CandidateScore
from fvs_engine.geometry import RigidTransform, look_at
from fvs_engine.pipeline.model import open_model
from fvs_engine.score import MedianFrequency, MedianFrequencyEstimate, MedianFrequencyFast, Scorer, rank
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView

NEIGHBOURS = 3
BESIDE = 0.15
"""Standard deviation of candidates from the line between two views: in spreads of the views, and in rad."""


def beside(views: list[PinholeView], count: int, seed: int) -> list[PinholeView]:
    """Poses between a view and one of its nearest neighbours, and off that line."""
    draw = np.random.default_rng(seed)
    centres = np.array([view.centre for view in views])
    spread = float(np.std(centres, axis=0).max())
    poses = []
    for first in draw.integers(0, len(views), count):
        near = np.argsort(np.linalg.norm(centres - centres[first], axis=1))
        second = near[draw.integers(1, 1 + NEIGHBOURS)]
        ends = [views[number].camera_from_model.inverse() for number in (first, second)]
        share = draw.uniform()
        turn = Slerp([0, 1], Rotation.from_matrix(np.stack([end.rotation for end in ends])))(share)
        place = (1.0 - share) * ends[0].translation + share * ends[1].translation
        turned = turn.as_matrix() @ Rotation.from_rotvec(draw.normal(0, BESIDE, 3)).as_matrix()
        moved = place + draw.normal(0, BESIDE * spread, 3)
        poses.append(RigidTransform(turned, moved).inverse())
    return _named(poses, views)


def rings(views: list[PinholeView], count: int) -> list[PinholeView]:
    """Three level rings around the point that is nearest to all the views' axes, at their usual distance."""
    centres = np.array([view.centre for view in views])
    axes = np.array([view.camera_from_model.rotation[2] for view in views])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    middle = np.linalg.solve(across.sum(0), (across @ centres[..., None]).sum(0)[:, 0])
    up = -np.mean([view.camera_from_model.rotation[1] for view in views], axis=0)
    up /= np.linalg.norm(up)
    east = np.cross(up, [1.0, 0.0, 0.3])
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    heights = (centres - middle) @ up
    distance = float(np.median(np.linalg.norm(centres - middle, axis=1)))
    height, step = float(np.median(heights)), max(float(np.std(heights)), 0.1 * distance)
    radius = float(np.sqrt(max(distance**2 - height**2, 0.2 * distance**2)))
    poses = []
    for ring in (-1, 0, 1):
        for angle in np.linspace(0, 2 * np.pi, count // 3, endpoint=False):
            out = radius * (np.cos(angle) * east + np.sin(angle) * north)
            eye = middle + out + (height + ring * step) * up
            poses.append(look_at(eye, middle, up).inverse())
    return _named(poses, views)


def _named(poses: list[RigidTransform], views: list[PinholeView]) -> list[PinholeView]:
    return [PinholeView(f"{n:04}", views[0].camera, pose) for n, pose in enumerate(poses)]


def row(
    name: str,
    gaussians: Gaussians,
    views: list[PinholeView],
    rasterizer: Rasterizer,
    first: int,
    clock: Callable[[], float],
) -> dict[str, Any]:
    """One set of candidates, scored in three ways."""

    def timed(scorer: Scorer) -> tuple[tuple[CandidateScore, ...], float]:
        began = clock()
        return scorer.score(gaussians, views, rasterizer), clock() - began

    for scorer in (MedianFrequency(), MedianFrequencyEstimate()):
        scorer.score(gaussians, views[:2], rasterizer)  # compiled, and read into memory
    with on_device(rasterizer.device):
        exact, exact_s = timed(MedianFrequency())
        estimates, estimate_s = timed(MedianFrequencyEstimate())
        fast, fast_s = timed(MedianFrequencyFast(first=first))
    both = [
        (e.score, f.score)
        for e, f in zip(exact, estimates, strict=True)
        if e.status == "ranked" and f.score is not None
    ]
    right = {place.name for place in rank(exact)[:first]} & {place.name for place in rank(fast)[:first]}
    return {
        "candidates": name,
        "Gaussians": len(gaussians),
        "count": len(views),
        "ρ of estimates": float(spearmanr(*zip(*both, strict=True)).statistic),
        "rendered": sum(not score.estimated for score in fast),
        "right": f"{len(right)} of {first}",
        "exact, s": exact_s,
        "estimates, s": estimate_s,
        "fast, s": fast_s,
        "fast / exact": fast_s / exact_s,
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", nargs="*", type=Path, metavar="MODEL")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processor-time", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    rasterizer = create_rasterizer("cpu")
    rows = []
    for path in options.models:
        model = open_model(path)
        sets = {
            "beside": beside(list(model.registered), options.count, options.seed),
            "rings": rings(list(model.registered), options.count),
        }
        for kind, views in sets.items():
            rows.append(row(f"{path.name}, {kind}", model.gaussians, views, rasterizer, options.first, clock))
            print(rows[-1], flush=True)
    if not options.models:
        views = room_candidates(options.count, 800, 600)
        rows.append(row("room", room(100_000), views, rasterizer, options.first, clock))
    report("rankings that render few candidates", rows, options.json)


if __name__ == "__main__":
    main()
