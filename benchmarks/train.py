r"""Time of a training step and of its parts.

    python benchmarks/train.py --scene fox=MODEL,IMAGES,960 --scene bonsai=MODEL,IMAGES,800 \
        [--sh-degree 0] [--steps 40] [--json results/train.json]

MODEL is a folder with a COLMAP model, IMAGES its photographs, the number the long side in px. The model is
trained from its sparse points without densification, so that every step does the same work. Goals: ≥ 70 %
of a step in the two blending kernels; 20× less than the 1.13 s of OpenSplat's CPU path on fox at 540×960.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

from measurement import Timing, report
from scenes import load_scene

from fvs_engine.monitor import Monitor
from fvs_engine.splat import densification, optimiser, trainer
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster import cpu, create_rasterizer
from fvs_engine.splat.raster.kernels import blending
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer

VIEWS = 24
WARMUP = 8


class Stopwatch:
    """Seconds per step of wrapped functions, by name."""

    def __init__(self) -> None:
        self.steps: list[dict[str, float]] = []
        self._now: dict[str, float] = defaultdict(float)

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self._now[name] += time.perf_counter() - start

        return timed

    def next_step(self) -> None:
        """Close the current step."""
        self.steps.append(dict(self._now))
        self._now = defaultdict(float)

    def median_s(self, name: str) -> float:
        """The median over steps after the warm-up."""
        return median(step.get(name, 0.0) for step in self.steps[WARMUP:])


@contextmanager
def timed_parts(watch: Stopwatch) -> Iterator[None]:
    """Time the parts of a step while the context is open."""
    targets: list[tuple[str, Any, str]] = [
        ("step", Trainer, "_step"),
        ("render", cpu.CpuRasterizer, "render"),
        ("blend", blending, "blend"),
        ("blend backward", blending, "blend_backward"),
        ("loss", trainer, "photometric_loss"),
        ("backward", cpu, "differentiate"),
        ("adam", optimiser.GaussianAdam, "step"),
        ("statistics", densification.GradientStatistics, "add"),
    ]
    with ExitStack() as stack:
        for name, owner, attribute in targets:
            timed = watch.wrap(name, getattr(owner, attribute))
            stack.enter_context(patch.object(owner, attribute, timed))
        yield


def train_scene(
    name: str, model: Path, images: Path, long_side_px: int, degree: int, steps: int
) -> dict[str, Any]:
    """One row: the step, its parts in ms, and the share of the two blending kernels."""
    scene = load_scene(model, images, long_side_px, limit=VIEWS)
    settings = TrainingSettings(
        sh_degree=degree, sh_degree_interval=1, densification=Densification(first_iteration=10**9)
    )
    gaussians = initialise_from_points(scene.points, scene.point_colors, degree)
    subject = Trainer(scene.views, gaussians, settings, create_rasterizer("cpu"))
    watch = Stopwatch()
    with timed_parts(watch):
        for step in range(WARMUP + steps):
            subject.train(step + 1, Monitor())
            watch.next_step()
    times = [step["step"] for step in watch.steps[WARMUP:]]
    ms = {part: 1e3 * watch.median_s(part) for part in watch.steps[-1]}
    kernels = ms["blend"] + ms["blend backward"]
    known = ms["render"] + ms["loss"] + ms["backward"] + ms["adam"] + ms["statistics"]
    camera = scene.views[0].camera
    return {
        "scene": name,
        "image": f"{camera.width}×{camera.height}",
        "Gaussians": len(gaussians),
        "SH": degree,
        "step": Timing(min(times), median(times), max(times), len(times)),
        "iterations/s": 1 / median(times),
        "blend ms": ms["blend"],
        "blend backward ms": ms["blend backward"],
        "rest of raster ms": ms["render"] + ms["backward"] - kernels,
        "loss ms": ms["loss"],
        "adam ms": ms["adam"],
        "statistics ms": ms["statistics"],
        "other ms": max(0.0, ms["step"] - known),
        "kernels %": 100 * kernels / ms["step"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scene", action="append", required=True, help="NAME=MODEL,IMAGES,LONG_SIDE_PX")
    parser.add_argument("--sh-degree", type=int, default=0)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    for scene in arguments.scene:
        name, _, place = scene.partition("=")
        model, images, long_side_px = place.rsplit(",", 2)
        rows.append(
            train_scene(
                name, Path(model), Path(images), int(long_side_px), arguments.sh_degree, arguments.steps
            )
        )
    report("train", rows, arguments.json)


if __name__ == "__main__":
    main()
