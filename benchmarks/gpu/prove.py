"""One step of the proof on a device: ``python benchmarks/gpu/prove.py STEP [BACKEND] --out FOLDER``.

``prove.sh`` runs all of them. A step writes what it measured, and whether that is good enough, to
FOLDER/STEP-BACKEND.json. ``table`` prints what all steps wrote, and joins it to FOLDER/proof.json.
"""

import argparse
import json
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parents[1]))

from measurement import machine
from proof import (
    CANDIDATES,
    SCORED,
    SETTINGS,
    Goldens,
    camera_of,
    candidate_scores,
    densified,
    gradients_of,
    moved_by_adam,
    trained,
)
from room import candidates, scene

from fvs_engine.monitor import Monitor
from fvs_engine.splat import densification as densification_module
from fvs_engine.splat import optimiser as optimiser_module
from fvs_engine.splat import trainer as trainer_module
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.losses import photometric_loss, photometric_loss_torch
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.settings import Densification
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.splat.views import TrainingView

Found = dict[str, Any]

COUNTS = (100_000, 1_000_000, 3_000_000)
FULL_HD = (1920, 1080)
TIMED_STEPS = 12


def parity(rasterizer: Rasterizer) -> Found:
    """Images and gradients of the hard scenes against the reference in float64."""
    goldens, worst = Goldens.read(), {}
    camera, pose = camera_of(goldens.facts["hard"])
    for name in sorted({key.split(".")[1] for key in goldens.tensors if key.startswith("scene.")}):
        expected = goldens.part(f"scene.{name}.")
        hard = SimpleNamespace(camera=camera, camera_from_model=pose, decided=expected["decided"])
        names = Gaussians.__dataclass_fields__
        gaussians = Gaussians(**{key: expected[key] for key in names}).to(rasterizer.device).requires_grad_()
        rendering, gradients = gradients_of(rasterizer, gaussians, hard)
        errors = {}
        for key in ("color", "alpha", "depth"):
            difference = (getattr(rendering, key).detach().cpu() - expected[key]).abs()[hard.decided]
            scale = max(1.0, float(expected[key].max())) if key == "depth" else 1.0
            errors[key] = float(difference.max()) / scale
        for key, gradient in gradients.items():
            wanted = expected[f"gradient.{key}"]
            if wanted.numel():
                largest = max(float(wanted.abs().max()), 1e-30)
                errors[f"gradient {key}"] = float((gradient.cpu() - wanted).abs().max()) / largest
        errors["seen differ"] = int((rendering.radii_px.detach().cpu() > 0).ne(expected["seen"]).sum())
        worst[name] = errors
    images = max(max(e["color"], e["alpha"], e["depth"]) for e in worst.values())
    gradients_off = max(v for e in worst.values() for k, v in e.items() if k.startswith("gradient"))
    return {
        "images": images,
        "gradients": gradients_off,
        "scenes": worst,
        "good": images <= 1e-4 and gradients_off <= 1e-3,
    }


def tf32(rasterizer: Rasterizer) -> Found:
    """The loss's gradient where detail is faint, with TF32 allowed and not, against float64."""
    draw = torch.Generator().manual_seed(5)
    y, x = torch.meshgrid(torch.linspace(0, 1, 270), torch.linspace(0, 1, 480), indexing="ij")
    smooth = torch.stack([0.3 + 0.4 * x, 0.5 + 0.3 * y, 0.4 + 0.2 * x * y], dim=-1)
    target = (
        (255 * (smooth + 0.004 * torch.randn(smooth.shape, generator=draw))).clamp(0, 255).to(torch.uint8)
    )
    exact = smooth.double().requires_grad_()
    photometric_loss_torch(exact, target.double() / 255).backward()  # type: ignore[no-untyped-call]
    assert exact.grad is not None
    color, image = smooth.to(rasterizer.device), target.to(rasterizer.device)
    errors = {}
    for allowed in (False, True):
        torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = allowed
        guard = StepGuard(rasterizer.device) if rasterizer.steps_on_device else None
        _, gradient = photometric_loss(color, image, guard=guard)
        difference = (gradient.cpu() - exact.grad).abs().max() / exact.grad.abs().max()
        errors["TF32 allowed" if allowed else "TF32 off"] = float(difference)
    return {**errors, "good": max(errors.values()) <= 1e-3}


def optimiser(rasterizer: Rasterizer) -> Found:
    """Three steps of Adam and a densification against the CPU."""
    goldens = Goldens.read()
    adam = _largest_difference(moved_by_adam(rasterizer), goldens.part("adam."))
    grown = densified(rasterizer)
    wanted = goldens.part("densified.")
    same = {name: tensor.shape for name, tensor in grown.items()} == {n: t.shape for n, t in wanted.items()}
    split = _largest_difference(grown, wanted) if same else float("inf")
    return {"adam": adam, "densification": split, "good": adam <= 1e-5 and split <= 1e-4}


def training(rasterizer: Rasterizer) -> Found:
    """500 steps with densification and a resume: PSNR against the CPU's, and a second run bit for bit."""
    goldens = Goldens.read()
    start = time.perf_counter()
    first = trained(rasterizer, goldens)
    seconds = time.perf_counter() - start
    again = trained(rasterizer, goldens)
    pairs = zip(first.gaussians.tensors().values(), again.gaussians.tensors().values(), strict=True)
    equal = all(torch.equal(one, other) for one, other in pairs)
    off = abs(first.psnr_db - goldens.facts["psnr_db"])
    good = off <= 0.3 and (equal or rasterizer.name != "triton")
    return {
        "dB": first.psnr_db, "dB of the CPU": goldens.facts["psnr_db"], "Gaussians": len(first.gaussians),
        "seconds": seconds, "bits equal": equal, "good": good,
    }  # fmt: skip


def steps(rasterizer: Rasterizer) -> Found:
    """The time of a step at 1080p by parts, its synchronisations, and the memory it needs."""
    rows, good = {}, True
    for count in COUNTS:
        rows[f"{count:,}"] = _timed_steps(rasterizer, count)
        good &= rows[f"{count:,}"]["synchronisations"] <= 1
    return {**rows, "good": good or rasterizer.name != "triton"}


def scores(rasterizer: Rasterizer) -> Found:
    """300 candidates: time, and their order against the CPU's."""
    found: Found = {}
    good = True
    for size, limit_s in zip(SCORED, (0.1, 1.0), strict=True):
        candidate_scores(rasterizer, size)  # compiles, and plans the FFT
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            values = candidate_scores(rasterizer, size)
            seconds.append(time.perf_counter() - start)
        expected = Goldens.read().tensors["scores.{}x{}".format(*size)].numpy()
        difference = float(np.nanmax(np.abs(np.array(values) - expected)))
        first_ten = len(set(np.argsort(values)[:10]) & set(np.argsort(expected)[:10]))
        found["{}×{}".format(*size)] = {
            "seconds": min(seconds),
            "goal s": limit_s,
            "largest difference": difference,
            "of the first ten": first_ten,
        }
        good &= difference <= 1e-3 and first_ten >= 9
    return {**found, "candidates": CANDIDATES, "good": good}


def memory(rasterizer: Rasterizer) -> Found:
    """Models of 0 and of 10 million Gaussians, images of 1 px and of 8,000 px, a NaN in a parameter."""
    found: Found = {}
    for name, gaussians, size in _extremes():
        (view,) = candidates(1, *size)
        with torch.no_grad():
            rendering = rasterizer.render(
                gaussians.to(rasterizer.device), view.camera, view.camera_from_model
            )
        found[name] = {"finite": bool(torch.isfinite(rendering.color).all()), "GiB": _peak_gib()}
    return {**found, "good": all(row["finite"] for row in found.values())}


STEPS_BY_NAME: dict[str, Callable[[Rasterizer], Found]] = {
    step.__name__: step for step in (parity, tf32, optimiser, training, steps, scores, memory)
}


def _timed_steps(rasterizer: Rasterizer, count: int) -> Found:
    """Milliseconds of a step and of its parts, median of some steps."""
    (view,) = candidates(1, *FULL_HD)
    image = np.random.default_rng(0).integers(0, 256, (FULL_HD[1], FULL_HD[0], 3), dtype=np.uint8)
    training = [TrainingView(view.name, view.camera, view.camera_from_model, image)]
    settings = SETTINGS.model_copy(
        update={"sh_degree": 0, "densification": Densification(first_iteration=10**6, last_iteration=10**6)}
    )
    trainer = Trainer(training, scene(count), settings, rasterizer)
    trainer.train(3, Monitor())
    torch.cuda.reset_peak_memory_stats()
    watch = _Watch()
    with _watched(watch, rasterizer):
        for _ in range(TIMED_STEPS):
            with watch.part("step"):
                trainer._step(10**6)
        torch.cuda.synchronize()
    trainer._settle(0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        trainer._step(10**6)
        torch.cuda.set_sync_debug_mode("default")
    start = time.perf_counter()
    trainer.train(trainer.iteration + TIMED_STEPS, Monitor())
    torch.cuda.synchronize()
    clock_ms = 1e3 * (time.perf_counter() - start) / TIMED_STEPS
    return {
        **{f"{name} ms": watch.median_ms(name) for name in watch.events},
        "step by the clock ms": clock_ms,
        "synchronisations": sum("synchroniz" in str(one.message) for one in caught),
        "GiB": _peak_gib(),
    }


class _Watch:
    """CUDA events around parts of steps."""

    def __init__(self) -> None:
        self.events: dict[str, list[tuple[Any, Any]]] = {}

    @contextmanager
    def part(self, name: str) -> Any:
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record()
        try:
            yield
        finally:
            end.record()
            self.events.setdefault(name, []).append((begin, end))

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.part(name):
                return function(*args, **kwargs)

        return timed

    def median_ms(self, name: str) -> float:
        return median(begin.elapsed_time(end) for begin, end in self.events[name])


@contextmanager
def _watched(watch: _Watch, rasterizer: Rasterizer) -> Any:
    """Time the parts of the steps that run in the block; the rest of a step is its bookkeeping."""
    render = "render_guarded" if hasattr(rasterizer, "render_guarded") else "render"
    targets: list[tuple[str, Any, str]] = [
        ("render", type(rasterizer), render),
        ("loss", trainer_module, "photometric_loss"),
        ("backward", torch.Tensor, "backward"),
        ("adam", optimiser_module.GaussianAdam, "step"),
        ("statistics", densification_module.GradientStatistics, "add"),
    ]
    with ExitStack() as stack:
        for name, owner, attribute in targets:
            timed = watch.wrap(name, getattr(owner, attribute))
            stack.enter_context(patch.object(owner, attribute, timed))
        yield


def _extremes() -> Iterator[tuple[str, Gaussians, tuple[int, int]]]:
    small = scene(1_000)
    yield "no Gaussian", Gaussians(**{name: tensor[:0] for name, tensor in small.tensors().items()}), (64, 48)
    yield "1 px", small, (1, 1)
    yield "8,000 px", small, (8_000, 6_000)
    yield "10 million Gaussians", scene(10_000_000), FULL_HD
    broken = scene(1_000)
    broken.means[7], broken.log_scales[8], broken.opacity_logits[9] = torch.nan, torch.nan, torch.nan
    yield "NaN", broken, (64, 48)


def _largest_difference(found: dict[str, Tensor], wanted: dict[str, Tensor]) -> float:
    return max(float((found[n] - wanted[n]).abs().max()) for n in wanted if wanted[n].numel())


def _peak_gib() -> float:
    return torch.cuda.max_memory_allocated() / 2**30 if torch.cuda.is_available() else 0.0


def table(folder: Path) -> None:
    """Print what the steps wrote, and join it to ``proof.json``."""
    joined = {file.stem: json.loads(file.read_text()) for file in sorted(folder.glob("*-*.json"))}
    (folder / "proof.json").write_text(json.dumps({"machine": machine(), "steps": joined}, indent=1) + "\n")
    for name, found in joined.items():
        print(f"{'good' if found.get('good') else 'BAD ':5} {name}")
        for key, value in found.items():
            if key not in ("good", "scenes"):
                print(f"        {key}: {_shown(value)}")


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_shown(one)}" for key, one in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("step", choices=[*STEPS_BY_NAME, "table"])
    parser.add_argument("backend", nargs="?", default="triton")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.step == "table":
        table(arguments.out)
        return
    start = time.perf_counter()
    try:
        found = STEPS_BY_NAME[arguments.step](create_rasterizer(arguments.backend))
    except Exception as error:  # one step that fails must not hide the others
        found = {"good": False, "error": repr(error), "traceback": traceback.format_exc()[-2000:]}
    found["took s"] = time.perf_counter() - start
    path = arguments.out / f"{arguments.step}-{arguments.backend}.json"
    path.write_text(json.dumps(found, indent=1) + "\n")
    print(f"{'good' if found['good'] else 'BAD '} {path.stem} {found['took s']:.1f} s", flush=True)


if __name__ == "__main__":
    main()
