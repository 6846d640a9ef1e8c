"""Quality and cost of training: PSNR and SSIM of held-out photographs, Gaussians, speed and peak memory.

    python benchmarks/quality.py --model DATA/bonsai/reference --images DATA/bonsai/images \
        --preset fine --iterations 7000 --long-side 800 --json results/quality.json

Every eighth view by name is held out. Without ``--preset``, the 3DGS paper's settings are those of all
iterations, at full size. With ``--checkpoint FILE`` the run is saved every 500 iterations and
resumes there when it is started again.
"""

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
import torch
from measurement import report
from scenes import Scene, load_scene

from fvs_engine.monitor import Monitor, Progress
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.metrics import psnr, ssim
from fvs_engine.splat.ply import write_ply
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.settings import PRESETS, TrainingSettings
from fvs_engine.splat.trainer import Trainer

STRIDE = 500


def main() -> None:
    arguments = _parse()
    scene = load_scene(arguments.model, arguments.images, arguments.long_side)
    preset = PRESETS[arguments.preset] if arguments.preset else TrainingSettings()
    limits = {"sh_degree": arguments.sh_degree, "max_gaussians": arguments.max_gaussians}
    settings = preset.model_copy(update=limits).with_iterations(arguments.iterations)
    rasterizer = create_rasterizer(arguments.backend)
    checkpoint: Path | None = arguments.checkpoint
    if checkpoint is not None and checkpoint.exists():
        trainer = Trainer.resume(checkpoint, scene.training, rasterizer)
    else:
        gaussians = initialise_from_points(scene.points, scene.point_colors, settings.sh_degree)
        trainer = Trainer(scene.training, gaussians, settings, rasterizer, seed=arguments.seed)
    begun, start, processor_start = trainer.iteration, time.perf_counter(), time.process_time()
    while trainer.iteration < settings.iterations:
        trainer.train(min(settings.iterations, trainer.iteration + STRIDE), Monitor(_print))
        if checkpoint is not None:
            trainer.save(checkpoint)
    seconds, processor_s = time.perf_counter() - start, time.process_time() - processor_start
    if arguments.ply is not None:
        write_ply(arguments.ply, trainer.gaussians)
    psnr_db, similarity = evaluate(trainer, scene)
    row = {
        "scene": arguments.model.parent.name,
        "size_px": f"{scene.views[0].camera.width}×{scene.views[0].camera.height}",
        "iterations": trainer.iteration,
        "preset": arguments.preset or "",
        "sh_degree": settings.sh_degree,
        "psnr_db": psnr_db,
        "ssim": similarity,
        "gaussians": len(trainer.gaussians),
        "iterations_per_s": (trainer.iteration - begun) / seconds if seconds else 0.0,
        "processor_s": processor_s,
        "peak_memory_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        "seed": arguments.seed,
    }
    report("quality", [row], arguments.json)
    print(json.dumps(row, ensure_ascii=False))


def evaluate(trainer: Trainer, scene: Scene) -> tuple[float, float]:
    """Mean PSNR in dB and mean SSIM over the held-out views."""
    scores = []
    with torch.no_grad():
        for view in scene.held_out:
            rendering = trainer.rasterizer.render(trainer.gaussians, view.camera, view.camera_from_model)
            color = rendering.color.clamp(0, 1).cpu().numpy()
            photograph = view.image / 255
            scores.append((psnr(color, photograph), ssim(color, photograph)))
    psnr_db, similarity = np.mean(scores, axis=0)
    return float(psnr_db), float(similarity)


def _print(progress: Progress) -> None:
    if progress.done % 100 == 0:
        details = ", ".join(f"{key} {value:.4g}" for key, value in progress.detail.items())
        print(f"{progress.done}: {details}", flush=True)


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=Path, required=True, help="folder of a COLMAP model")
    parser.add_argument("--images", type=Path, required=True, help="folder of its photographs")
    parser.add_argument("--iterations", type=int, default=7_000)
    parser.add_argument("--preset", choices=tuple(PRESETS), help="its rates, levels and densification")
    parser.add_argument("--sh-degree", type=int, default=3)
    parser.add_argument("--long-side", type=int, default=800)
    parser.add_argument("--max-gaussians", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--ply", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
