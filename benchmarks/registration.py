"""Calibration of the chance that a view will be registered: familiar points against what happens.

    python benchmarks/registration.py DATASET [DATASET …] [--counts 10 20] [--spread far near] [--seeds 0 1]
        [--others 60] [--json registration.json] [--again registration.json …]

Each DATASET has poses (bonsai: in `reference`). Sets of its views, far from one another or side by side, are
reconstructed with noisy pose priors, and other views are localised in the model, alone, by ordinary matching
without a prior. A view counts as registered when its centre is at most 3 % of the spread of the dataset's
cameras off. ``--again`` reads the views of earlier runs instead of measuring.

For each scene the curve (familiar points with an even chance, slope) and the number of familiar points that
nine of ten views with as many are registered with come from all other scenes, and are judged on it: the area
under its receiver operating characteristic (AUC), Brier's score, and precision and recall of the threshold.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from measurement import report
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import rankdata

from fvs_engine.choices import InitialChoice
from fvs_engine.errors import EngineError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.dataset import align_dataset
from fvs_engine.monitor import Monitor
from fvs_engine.plan.familiarity import ENOUGH, EVEN_CHANCE, SLOPE, Familiarity
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.scene.sparse_points import read_observations
from fvs_engine.select.candidate_views import comparable_views
from fvs_engine.select.initial_views import initial_views
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.splat.raster import Rasterizer, create_rasterizer

SPREADS: dict[str, InitialChoice] = {"far": "farthest", "near": "consecutive"}
PRECISION = 0.9
WRONG_SHARE = 0.03


@dataclass(frozen=True)
class Tried:
    """A view that was localised in a model of ``views`` views, or not."""

    scene: str
    views: int
    spread: str
    seed: int
    name: str
    familiar: float
    registered: bool


def tried(
    dataset: Dataset, count: int, spread: str, seed: int, others: int, rasterizer: Rasterizer
) -> list[Tried]:
    """What becomes of views that are drawn from those outside of a set."""
    settings = SceneSettings(seed=seed, sfm=SfmSettings(threads=1, seed=seed), long_side_px=256)
    names = initial_views(dataset.views, count, SPREADS[spread], seed)
    rest = [name for name in dataset.names if name not in names]
    draw = np.random.default_rng(seed)
    guests = sorted(draw.choice(rest, min(others, len(rest)), replace=False).tolist())
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.open(Path(folder), dataset, settings, rasterizer, Monitor())
        scene.add(names, Monitor())
        assert scene.model_dir is not None
        alignment = align_dataset(
            [dataset.by_name[view.name].camera_from_model.inverse() for view in scene.views],
            [view.camera_from_model.inverse() for view in scene.views],
        ).model_from_world
        expected = comparable_views(
            dataset, {name: scene.expected_camera(name) for name in guests}, alignment
        )
        familiar = Familiarity(read_observations(scene.model_dir), expected).counts
        found = scene.localise(guests, Monitor())
    spread_of_all = alignment.scale * centre_spread(np.stack([view.centre for view in dataset.views]))
    return [
        Tried(
            dataset.name,
            count,
            spread,
            seed,
            view.name,
            float(points),
            view.name in found
            and float(np.linalg.norm(found[view.name].centre - view.centre)) <= WRONG_SHARE * spread_of_all,
        )
        for view, points in zip(expected, familiar, strict=True)
    ]


def measured(options: argparse.Namespace) -> Iterator[Tried]:
    """All views of all sets; sets that do not become a model are named and left out."""
    rasterizer = create_rasterizer("cpu")
    for folder in options.datasets:
        dataset = open_dataset(folder)
        for count in options.counts:
            for spread in options.spread:
                for seed in options.seeds:
                    try:
                        found = tried(dataset, count, spread, seed, options.others, rasterizer)
                    except EngineError as error:
                        print(
                            f"{dataset.name}, {count} {spread} views, seed {seed}: {error.message}",
                            flush=True,
                        )
                        continue
                    registered = sum(view.registered for view in found)
                    print(
                        f"{dataset.name}, {count} {spread} views, seed {seed}: {registered} of {len(found)}",
                        flush=True,
                    )
                    yield from found


def curve(familiar: NDArray[np.float64], registered: NDArray[np.bool_]) -> tuple[float, float]:
    """The most likely logistic curve of the logarithm: (points with an even chance, slope)."""
    logs = np.log(np.maximum(familiar, 1e-3))

    def loss(parameters: NDArray[np.float64]) -> float:
        logits = np.exp(parameters[1]) * (logs - parameters[0])
        return float(np.logaddexp(0.0, np.where(registered, -logits, logits)).sum())

    middle, log_slope = minimize(loss, [np.log(EVEN_CHANCE), np.log(SLOPE)], method="Nelder-Mead").x
    return float(np.exp(middle)), float(np.exp(log_slope))


def chance(familiar: NDArray[np.float64], even: float, slope: float) -> NDArray[np.float64]:
    """The chance of views with so many familiar points."""
    return np.asarray(expit(slope * np.log(np.maximum(familiar, 1e-3) / even)))


def enough(familiar: NDArray[np.float64], registered: NDArray[np.bool_]) -> float:
    """The fewest familiar points such that nine of ten views with at least as many are registered."""
    order = np.argsort(-familiar, kind="stable")
    precision = np.cumsum(registered[order]) / np.arange(1, len(order) + 1)
    fitting = np.flatnonzero(precision >= PRECISION)
    return float(familiar[order][fitting[-1]]) if len(fitting) else float("inf")


def area(familiar: NDArray[np.float64], registered: NDArray[np.bool_]) -> float:
    """Chance that a registered view has more familiar points than one that is not."""
    good, bad = int(registered.sum()), int((~registered).sum())
    if not good or not bad:
        return float("nan")
    return float((rankdata(familiar)[registered].sum() - good * (good + 1) / 2) / (good * bad))


def left_out(found: Sequence[Tried]) -> list[dict[str, Any]]:
    """Each scene, judged by what the others give and by what the product has; and all together."""
    rows = []
    for scene in (*dict.fromkeys(view.scene for view in found), "all"):
        own = [view for view in found if scene in (view.scene, "all")]
        others = [view for view in found if view.scene != scene]
        familiar, registered = _arrays(own)
        even, slope = curve(*_arrays(others))
        threshold = enough(*_arrays(others))
        for name, (curve_even, curve_slope, least) in {
            "all others" if scene != "all" else "itself": (even, slope, threshold),
            "the product": (EVEN_CHANCE, SLOPE, ENOUGH),
        }.items():
            taken = familiar >= least
            rows.append(
                {
                    "scene": scene,
                    "views": len(own),
                    "registered": int(registered.sum()),
                    "AUC": area(familiar, registered),
                    "by": name,
                    "even chance": curve_even,
                    "slope": curve_slope,
                    "Brier": float(np.mean((chance(familiar, curve_even, curve_slope) - registered) ** 2)),
                    "enough": least,
                    "precision": float(registered[taken].mean()) if taken.any() else float("nan"),
                    "recall": float(taken[registered].mean()) if registered.any() else float("nan"),
                }
            )
    return rows


def _arrays(views: Sequence[Tried]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    return np.array([view.familiar for view in views]), np.array([view.registered for view in views])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("datasets", type=Path, nargs="*")
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 20])
    parser.add_argument("--spread", nargs="+", default=list(SPREADS), choices=list(SPREADS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--others", type=int, default=60, help="views that are tried with each set, at most")
    parser.add_argument("--again", type=Path, nargs="+", default=[], metavar="JSON")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    earlier = [Tried(**row) for path in options.again for row in json.loads(path.read_text())["rows"]]
    found = earlier + list(measured(options))
    if not found:
        parser.error("give a dataset, or --again with the results of an earlier run")
    report("Views that were tried", [asdict(view) for view in found], options.json)
    report("Leave one scene out", left_out(found))


if __name__ == "__main__":
    main()
