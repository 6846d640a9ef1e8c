"""Speed of choosing the next view: candidates/s of every selector, from 10 to 250 candidates.

   python benchmarks/selection.py [--counts 10 50 250] [--visited 20] [--backend cpu] [--processor-time]
                                  [--selectors fisher coverage] [--json selection.json]

The simulated room, at the size of a thumbnail. For every selector and count: the time of a whole selection
beside that of a render of all candidates in the same run, their ratio, and candidates/s (the same for all
counts where visited views cost nothing; fisher, d-optimal and coverage look at every one of them).
"""

import argparse
import random
import time
from pathlib import Path
from typing import Any

import torch
from measurement import measure_side_by_side, report
from room import candidates, scene

from fvs_engine.lab.baselines import SELECTORS, create_selector
from fvs_engine.score.selectors.interface import SelectionContext, select
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import PinholeView

SIZE = (256, 170)


def context(gaussians: Gaussians, rasterizer: Rasterizer, visited: int, count: int) -> SelectionContext:
    """A context with this many visited views and candidates, at random poses in the room."""
    views = candidates(visited + count, *SIZE)
    order = {view.name: place for place, view in enumerate(views)}
    random.Random(0).shuffle(views)
    return SelectionContext(
        gaussians=gaussians,
        rasterizer=rasterizer,
        sh_degree=0,
        visited=tuple(views[:visited]),
        candidates=tuple(views[visited:]),
        order=order,
        budget=2 * visited,
        seed=0,
        step=0,
    )


def render_all(views: tuple[PinholeView, ...], gaussians: Gaussians, rasterizer: Rasterizer) -> None:
    """Render all candidates: the least work of a selector that uses renders."""
    with torch.no_grad():
        for view in views:
            rasterizer.render(gaussians, view.camera, view.camera_from_model, sh_degree=0)


def row(name: str, here: SelectionContext, repeat: int, processor_time: bool) -> dict[str, Any]:
    """One selector on one context."""
    selector = create_selector(name)
    times = measure_side_by_side(
        {
            "selection": lambda: select(here, selector, {}),
            "renders": lambda: render_all(here.candidates, here.gaussians, here.rasterizer),
        },
        repeat,
        clock=time.process_time if processor_time else time.perf_counter,
    )
    return {
        "selector": name,
        "candidates": len(here.candidates),
        "selection": times["selection"],
        "renders": times["renders"],
        "candidates/s": len(here.candidates) / times["selection"].median_s,
        "× renders": times["selection"].median_s / times["renders"].median_s,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--gaussians", type=int, default=20_000)
    parser.add_argument("--visited", type=int, default=20)
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 50, 250], help="of candidates")
    parser.add_argument("--selectors", nargs="+", choices=SELECTORS, default=list(SELECTORS))
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--processor-time", action="store_true", help="of all threads, for a busy machine")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rasterizer = create_rasterizer(options.backend)
    gaussians = scene(options.gaussians).to(rasterizer.device)
    rows = []
    for name in options.selectors:
        for count in options.counts:
            here = context(gaussians, rasterizer, options.visited, count)
            rows.append(row(name, here, options.repeat, options.processor_time))
    clock = "processor time" if options.processor_time else "wall time"
    report(
        f"selection, {rasterizer.name} rasteriser, {options.gaussians:,} Gaussians, {SIZE[0]}×{SIZE[1]} px, "
        f"{options.visited} visited, {clock}",
        rows,
        options.json,
    )


if __name__ == "__main__":
    main()
