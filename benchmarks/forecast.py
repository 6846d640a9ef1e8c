"""Forecasts of PSNR against what came: error of the mean, and coverage of the interval.

    python benchmarks/forecast.py DATASET [--colmap MODEL] [--methods kriging farthest median-frequency]
        [--seeds 0 1] [--budget 40] [--counts 10 20 40] [--stop-at-db 20 22] [--long-side 256]
        [--json forecast.json]

Known poses. A selection runs from four views side by side to the budget; before every visit its forecast for
all views that may be visited is compared with the mean PSNR of the model's renders of them, and the forecast
of the end (of the best plan, which ``kriging`` follows) with that mean at the end. The second table says when
``--stop-at-db`` would have ended a selection: photographs, travel, and the quality that was there.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from growth import quality_db
from measurement import report
from view_sets import with_points

from fvs_engine.lab.baselines import create_selector
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.select.loop import LoopSettings, SelectionLoop, StepRecord
from fvs_engine.splat.raster import Rasterizer, create_rasterizer


def steps(
    dataset: Dataset, method: str, seed: int, options: argparse.Namespace, rasterizer: Rasterizer
) -> list[dict[str, Any]]:
    """One row per step: what was expected of the model then, and what it was."""
    training = SCENE_TRAINING.model_copy(update={"max_gaussians": options.max_gaussians})
    settings = LoopSettings(
        scene=SceneSettings(poses="known", long_side_px=options.long_side, training=training, seed=seed),
        method=method,
        initial=4,
        initial_choice="consecutive",
        budget=options.budget,
        nearest=len(dataset.views),
        seed=seed,
    )
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        loop = SelectionLoop.open(
            Path(folder) / "loop", dataset, settings, create_selector(method), rasterizer, Monitor()
        )
        loop.begin(Monitor())
        views = list(loop.scene.localise(loop.pool, Monitor()).values())
        while True:
            true_db = quality_db(loop.model, views, rasterizer)
            step = loop.step(Monitor())
            if not isinstance(step, StepRecord):
                break
            outlook = step.choice.outlook
            row = {
                "dataset": dataset.name,
                "selector": method,
                "seed": seed,
                "views": step.views - 1,
                "travel": step.travel - step.choice.distance,
                "true, dB": true_db,
            }
            for name, expectation in (("now", outlook.now), ("end", outlook.end)):
                forecast = expectation.forecast
                row[f"{name}, dB"] = forecast.db if forecast else None
                row[f"{name}, low"] = forecast.low_db if forecast else None
                row[f"{name}, high"] = forecast.high_db if forecast else None
            found.append(row)
    for row in found:
        row["true at the end, dB"] = true_db
    return found


def errors(rows: list[dict[str, Any]], counts: list[int]) -> list[dict[str, Any]]:
    """Mean absolute error and coverage of the forecasts, at some numbers of views and over all steps."""
    table = []
    for name, truth in (("now", "true, dB"), ("end", "true at the end, dB")):
        known = [row for row in rows if row[f"{name}, dB"] is not None]
        for count in (*counts, None):
            some = [row for row in known if count is None or row["views"] == count]
            if not some:
                continue
            apart = np.array([row[f"{name}, dB"] - row[truth] for row in some])
            held = [row[f"{name}, low"] <= row[truth] <= row[f"{name}, high"] for row in some]
            table.append(
                {
                    "forecast of": name,
                    "made at": "all steps" if count is None else f"{count} views",
                    "forecasts": len(some),
                    "mean error, dB": float(apart.mean()),
                    "mean absolute error, dB": float(np.abs(apart).mean()),
                    "interval holds": float(np.mean(held)),
                    "half width, dB": float(
                        np.mean([row[f"{name}, high"] - row[f"{name}, low"] for row in some]) / 2
                    ),
                }
            )
    return table


def stops(rows: list[dict[str, Any]], wanted: list[float]) -> list[dict[str, Any]]:
    """When each selection would have ended at a quality."""
    table = []
    for db in wanted:
        for key in sorted({(row["dataset"], row["selector"], row["seed"]) for row in rows}):
            run = [row for row in rows if (row["dataset"], row["selector"], row["seed"]) == key]
            ended = next((row for row in run if row["now, dB"] is not None and row["now, dB"] >= db), None)
            dataset, selector, seed = key
            table.append(
                {
                    "dataset": dataset,
                    "selector": selector,
                    "seed": seed,
                    "stop at, dB": db,
                    "views": ended["views"] if ended else None,
                    "of": run[-1]["views"] + 1,
                    "travel": ended["travel"] if ended else None,
                    "of travel": run[-1]["travel"],
                    "true, dB": ended["true, dB"] if ended else None,
                }
            )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs select`")
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--methods", nargs="+", default=["kriging", "farthest", "median-frequency"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--budget", type=int, default=40)
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 20, 39])
    parser.add_argument("--stop-at-db", type=float, nargs="+", default=[20.0, 22.0])
    parser.add_argument("--long-side", type=int, default=256)
    parser.add_argument("--max-gaussians", type=int, default=25_000)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    rasterizer = create_rasterizer(options.backend)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        dataset = with_points(open_dataset(options.dataset, options.colmap), Path(folder))
        for method in options.methods:
            for seed in options.seeds:
                rows += steps(dataset, method, seed, options, rasterizer)
                print(method, seed, rows[-1], flush=True)
    report(
        f"forecasts, {options.long_side} px, {rasterizer.name}", errors(rows, options.counts), options.json
    )
    report("stopping", stops(rows, options.stop_at_db), None)


if __name__ == "__main__":
    main()
