"""One step of the proof on a device: ``python benchmarks/gpu/prove.py STEP [BACKEND] --out FILE``.

``prove.sh`` runs all of them. A step writes what it measured, and whether that is good enough, to FILE, and
does so again after each of its parts: what they find is not lost when a later one fails or takes too long.
"""

import argparse
import contextlib
import gc
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parents[1]))

from measurement import machine
from proof import (
    DRY,
    FULL,
    Extent,
    Goldens,
    Scoring,
    camera_of,
    densified,
    gradients_of,
    moved_by_adam,
    squares_of,
    trained,
)
from room import candidates, scene
from step_times import peak_gib, profiled_step, reset_peak, timed_steps, wait_for

from fvs_engine.errors import DeviceMemoryError
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.losses import photometric_loss, photometric_loss_torch, ssim_map
from fvs_engine.splat.raster import Rasterizer, SquaringRasterizer, create_rasterizer
from fvs_engine.splat.triton_kernels import photometric
from fvs_engine.splat.triton_kernels.guard import StepGuard

Found = dict[str, Any]
IMAGES_OFF, GRADIENTS_OFF = 1e-4, 1e-3
"""As in tests/fvs_engine/splat/raster/test_agreement.py; gradients relative to the largest."""
GOALS_S = (0.1, 1.0)


class Step:
    """A step that runs: the ``rasterizer``, the ``extent``, and what it ``found``, kept in a file."""

    def __init__(self, backend: str, extent: Extent, path: Path) -> None:
        self.extent, self._path = extent, path
        self.found: Found = {"good": True, "unfinished": True}
        self._start = time.perf_counter()
        self.keep()
        self._backend = backend

    @cached_property
    def rasterizer(self) -> Rasterizer:
        """The backend; made on first use, where a failure is kept."""
        return create_rasterizer(self._backend)

    @property
    def is_ours(self) -> bool:
        """Whether the backend is the one to be proven: gsplat's numbers are for comparison."""
        return self.rasterizer.name == "triton"

    def keep(self) -> None:
        """Write what was found so far."""
        self.found["took s"] = time.perf_counter() - self._start
        self._path.write_text(json.dumps(self.found, indent=1) + "\n")

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[Found]:
        """A part that fills its row; a failure is kept, and the step goes on with the next."""
        row: Found = {}
        self.found[name] = row
        try:
            yield row
            wait_for(self.rasterizer.device)
        except Exception as error:
            row |= {"good": False, "error": repr(error)[:500], "traceback": traceback.format_exc()[-2000:]}
        finally:
            self.found["good"] &= bool(row.get("good", True))
            self.keep()


def parity(step: Step) -> None:
    """Images, gradients and squares of the hard scenes against the reference in float64."""
    goldens = Goldens.read(step.extent)
    camera, pose = camera_of(goldens.facts["hard"])
    for name in goldens.scenes():
        with step.part(name) as row:
            expected = goldens.part(f"scene.{name}.")
            hard = SimpleNamespace(camera=camera, camera_from_model=pose, decided=expected["decided"])
            names = Gaussians.__dataclass_fields__
            given = Gaussians(**{key: expected[key] for key in names})
            rasterizer = step.rasterizer
            gaussians = Gaussians(**given.to(rasterizer.device).tensors()).requires_grad_()
            rendering, gradients = gradients_of(rasterizer, gaussians, hard)
            errors: dict[str, dict[str, float]] = {"images": {}, "gradients": {}, "squares": {}}
            for key in ("color", "alpha", "depth"):
                difference = (getattr(rendering, key).detach().cpu() - expected[key]).abs()[hard.decided]
                scale = max(1.0, float(expected[key].max())) if key == "depth" else 1.0
                errors["images"][key] = float(difference.max()) / scale
            for key, gradient in gradients.items():
                errors["gradients"][key] = _off(gradient, expected[f"gradient.{key}"])
            if isinstance(rasterizer, SquaringRasterizer):
                for key, square in squares_of(rasterizer, given.to(rasterizer.device), hard).items():
                    errors["squares"][key] = _off(square, expected[f"square.{key}"])
            row |= {key: max(each.values(), default=0.0) for key, each in errors.items()}
            seen = rendering.radii_px.detach().cpu() > 0
            row |= {"seen differ": int((seen != expected["seen"]).sum()), "details": errors}
            each = [(one, IMAGES_OFF) for one in errors["images"].values()]
            each += [(one, GRADIENTS_OFF) for key in ("gradients", "squares") for one in errors[key].values()]
            # Written so that NaN is not good.
            within = all(one <= limit for one, limit in each) and row["seen differ"] == 0
            row["good"] = within or not step.is_ours


def tf32(step: Step) -> None:
    """The loss and SSIM where detail is faint, with TF32 allowed and not, against float64."""
    draw = torch.Generator().manual_seed(5)
    width, height = step.extent.scored[0]
    y, x = torch.meshgrid(torch.linspace(0, 1, height), torch.linspace(0, 1, width), indexing="ij")
    smooth = torch.stack([0.3 + 0.4 * x, 0.5 + 0.3 * y, 0.4 + 0.2 * x * y], dim=-1)
    noise = 0.004 * torch.randn(smooth.shape, generator=draw)
    target = (255 * (smooth + noise)).clamp(0, 255).to(torch.uint8)
    exact = smooth.double().requires_grad_()
    photometric_loss_torch(exact, target.double() / 255).backward()  # type: ignore[no-untyped-call]
    assert exact.grad is not None
    ssim = ssim_map(smooth.double(), target.double() / 255)
    differ = (exact.detach() - target.double() / 255).abs() > 1e-6  # else rounding decides L1's sign
    color, image = smooth.to(step.rasterizer.device), target.to(step.rasterizer.device)
    for allowed in (False, True):
        with step.part("TF32 allowed" if allowed else "TF32 off") as row:
            torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = allowed
            guard = StepGuard(step.rasterizer.device)
            row["gradient"] = _off(
                photometric_loss(color, image, guard=guard)[1].cpu() * differ, exact.grad * differ
            )
            row["ssim"] = float((ssim_map(color, image.float() / 255).cpu() - ssim).abs().max())
            row["good"] = row["gradient"] <= 1e-3 and row["ssim"] <= 1e-3
    with step.part("convolved in TF32") as row:  # what it would cost: the two above must not be so
        blurred = torch.nn.functional.conv2d(color.permute(2, 0, 1)[:, None], color.new_ones(1, 1, 11, 11))
        torch.backends.cudnn.allow_tf32 = False
        plain = torch.nn.functional.conv2d(color.permute(2, 0, 1)[:, None], color.new_ones(1, 1, 11, 11))
        row["relative"] = float(((blurred - plain).abs() / plain).max())


def optimiser(step: Step) -> None:
    """Three steps of Adam and a densification against the CPU."""
    goldens = Goldens.read(step.extent)
    for name, compute, limit in (("adam", moved_by_adam, 1e-5), ("densified", densified, 1e-4)):
        with step.part(name) as row:
            found, wanted = compute(step.rasterizer, step.extent), goldens.part(f"{name}.")
            same = {key: t.shape for key, t in found.items()} == {key: t.shape for key, t in wanted.items()}
            off = [float((found[key] - wanted[key]).abs().max()) for key in wanted if wanted[key].numel()]
            row["difference"] = max(off) if same else float("inf")
            row["good"] = all(one <= limit for one in off) and same


def training(step: Step) -> None:
    """500 steps with densification and a resume: PSNR against the CPU's, and bits that nothing changes."""
    facts = Goldens.read(step.extent).facts
    first: dict[str, Tensor] = {}
    ways = {"resumed": {}, "again": {}, "uninterrupted": {"resumed": False}, "cramped": {"cramped": True}}
    for name, way in ways.items():
        with step.part(name) as row:
            start = time.perf_counter()
            result = trained(step.rasterizer, step.extent, **way)
            tensors = {key: tensor.detach() for key, tensor in result.gaussians.tensors().items()}
            first = first or tensors
            equal = all(torch.equal(tensors[key], tensor) for key, tensor in first.items())
            row |= {
                "seconds": time.perf_counter() - start,
                "dB": result.psnr_db,
                "dB of the CPU": facts["psnr_db"],
                "Gaussians": len(result.gaussians),
                "Gaussians of the CPU": facts["gaussians"],
                "bits equal": equal,
                "good": abs(result.psnr_db - facts["psnr_db"]) <= 0.3 and (equal or not step.is_ours),
            }


def steps(step: Step) -> None:
    """The time of a step at 1080p by parts, its synchronisations, and the memory it needs."""
    for count, degree in step.extent.counts:
        with step.part(f"{count:,} of degree {degree}") as row:
            row |= timed_steps(step.rasterizer, step.extent, count, degree)
            row["good"] = row.get("synchronisations", 0) == 0 or not step.is_ours
        gc.collect()


def kernels(step: Step) -> None:
    """The kernels of a step, and what the driver was asked for."""
    count, degree = step.extent.counts[1]
    with step.part(f"{count:,} of degree {degree}") as row:
        row |= profiled_step(step.rasterizer, step.extent, count, degree)


def scores(step: Step) -> None:
    """300 candidates, batched and one by one: time, and scores against the CPU's."""
    goldens = Goldens.read(step.extent)
    for size, goal_s in zip(step.extent.scored, GOALS_S, strict=True):
        name = "{}x{}".format(*size)
        expected = goldens.tensors[f"scores.{name}"].numpy()
        scoring = Scoring(step.rasterizer, step.extent, size)
        for one_by_one in (False, True):
            with step.part(f"{name} {'one by one' if one_by_one else 'batched'}") as row:
                reset_peak(step.rasterizer.device)
                scoring.scores(one_by_one=one_by_one)  # compiles, and plans the FFT
                seconds = []
                for _ in range(3):
                    start = time.perf_counter()
                    values = np.array(scoring.scores(one_by_one=one_by_one))
                    seconds.append(time.perf_counter() - start)
                row |= {"s": min(seconds), "goal s": goal_s, "peak GiB": peak_gib(step.rasterizer.device)}
                row["difference"] = float(np.abs(values - expected)[np.isfinite(expected)].max())
                order = (np.argsort(values)[:10], np.argsort(expected)[:10])
                row["of the first ten"] = len({*order[0]} & {*order[1]})
                same = bool((np.isnan(values) == np.isnan(expected)).all())
                row["good"] = same and row["difference"] <= 1e-3
                row["good"] &= row["of the first ten"] >= min(9, len(values))


def extremes(step: Step) -> None:
    """0 and 10 million Gaussians, images of 1 px and 8,000 px, NaN: an image, and every gradient finite."""
    device = step.rasterizer.device
    for name, make, size in _extremes(step.extent):
        with step.part(name) as row:
            reset_peak(device)
            (view,) = candidates(1, *size)
            gaussians = Gaussians(**make().to(device).tensors()).requires_grad_()
            rendering = step.rasterizer.render(gaussians, view.camera, view.camera_from_model)
            target = torch.zeros_like(rendering.color, dtype=torch.uint8)
            loss, gradient = photometric_loss(rendering.color, target, guard=StepGuard(device))
            rendering.color.backward(gradient)  # type: ignore[no-untyped-call]
            row["good"] = bool(torch.isfinite(rendering.color).all() & torch.isfinite(loss))
            row["alpha"] = float(rendering.alpha.detach().mean())
            seen = rendering.radii_px > 0
            row["seen"] = int(seen.sum())
            for tensor in gaussians.tensors().values():
                if tensor.grad is not None:
                    row["good"] &= bool(torch.isfinite(tensor.grad).all())
            row["peak GiB"] = peak_gib(device)
    if device.type == "cuda":
        with step.part("memory runs out") as row:
            _run_out_of_memory(step, row)


STEPS: dict[str, Callable[[Step], None]] = {
    step.__name__: step for step in (parity, tf32, optimiser, training, steps, kernels, scores, extremes)
}


def _run_out_of_memory(step: Step, row: Found) -> None:
    """Training that needs more than it may have says so, and leaves a device that works."""
    reset_peak(step.rasterizer.device)
    count, degree = step.extent.counts[1]
    torch.cuda.set_per_process_memory_fraction(2**29 / torch.cuda.get_device_properties(0).total_memory)
    row["good"] = False
    try:
        timed_steps(step.rasterizer, step.extent, count, degree)
    except DeviceMemoryError as error:
        row |= {"good": True, "said": str(error)}
    finally:
        torch.cuda.set_per_process_memory_fraction(1.0)
    reset_peak(step.rasterizer.device)
    (view,) = candidates(1, 64, 48)
    model = scene(100).to(step.rasterizer.device)
    row["held GiB"] = peak_gib(step.rasterizer.device)
    image = step.rasterizer.render(model, view.camera, view.camera_from_model).color
    row["good"] &= bool(torch.isfinite(image).all())


def _extremes(extent: Extent) -> Iterator[tuple[str, Callable[[], Gaussians], tuple[int, int]]]:
    most, (width, height) = extent.extremes

    def none() -> Gaussians:
        return Gaussians(**{name: tensor[:0] for name, tensor in scene(10).tensors().items()})

    def broken() -> Gaussians:
        some = scene(min(1_000, most))
        some.means[7], some.log_scales[8], some.opacity_logits[9] = torch.nan, torch.nan, torch.nan
        some.quaternions_wxyz[6] = torch.nan
        return some

    yield "no Gaussian", none, (64, 48)
    yield "1 px", lambda: scene(min(1_000, most)), (1, 1)
    yield "NaN", broken, (64, 48)
    yield f"{width:,} px", lambda: scene(min(1_000, most)), (width, height)
    yield f"{most:,} Gaussians", lambda: scene(most), extent.timed


def _off(found: Tensor, wanted: Tensor) -> float:
    """The largest difference, relative to the largest value; infinite for another shape."""
    if found.shape != wanted.shape:
        return float("inf")
    if wanted.numel() == 0:
        return 0.0
    largest = max(float(wanted.abs().max()), 1e-30)
    return float((found.detach().cpu() - wanted).abs().max()) / largest


def about() -> Found:
    """The machine, and how fast its device copies memory."""
    found: Found = machine() | {"torch": torch.__version__, "cuda": torch.version.cuda}
    with contextlib.suppress(ImportError):
        import triton

        found["triton"] = triton.__version__
    if torch.cuda.is_available():
        properties = torch.cuda.get_device_properties(0)
        found |= {"sm": f"{properties.major}{properties.minor}", "GiB": properties.total_memory / 2**30}
        source = torch.zeros(1 << 28, device="cuda")
        target = torch.empty_like(source)
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        for _ in range(3):
            begin.record()
            target.copy_(source)
            end.record()
        torch.cuda.synchronize()
        found["copy GB/s"] = 2 * source.numel() * 4 / begin.elapsed_time(end) / 1e6
    found["good"] = torch.cuda.is_available() or os.environ.get("TRITON_INTERPRET") == "1"
    return found


def interpret() -> None:
    """Suit Triton's interpreter: it works in one thread, and computes all rows that a program takes."""
    numba.set_num_threads(1)
    photometric._ROWS = 8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("step", choices=["machine", *STEPS])
    parser.add_argument("backend", nargs="?", default="triton")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--dry-run", action="store_true")
    arguments = parser.parse_args()
    if arguments.step == "machine":
        arguments.out.write_text(json.dumps(about(), indent=1) + "\n")
        return
    if arguments.dry_run:
        interpret()
    step = Step(arguments.backend, DRY if arguments.dry_run else FULL, arguments.out)
    try:
        STEPS[arguments.step](step)
    except Exception as error:
        step.found |= {"good": False, "error": repr(error)[:500], "traceback": traceback.format_exc()[-2000:]}
    del step.found["unfinished"]
    step.keep()


if __name__ == "__main__":
    main()
