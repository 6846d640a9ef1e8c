"""What a GPU is held to, computed on the CPU.

    python benchmarks/gpu/goldens.py --model MODEL --images IMAGES
    python benchmarks/gpu/goldens.py --dry-run

MODEL is a folder with a COLMAP model, IMAGES its photographs. Writes ``goldens.safetensors`` beside this
file, at most 5 MB: scenes that break rasterisers, with the images and gradients of the reference in float64
and the CPU's squared derivatives; the scores of 300 candidates at two sizes; a training of 500 steps, with
its photographs; three steps of Adam; a densification. For a dry run of the proof it takes no photographs
and writes a few kB to ``goldens-dry.safetensors``.
"""

import argparse
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from safetensors.torch import save_file
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "fixtures"))
sys.path.insert(0, str(Path(__file__).parents[1]))

from proof import (
    DRY,
    FULL,
    Extent,
    Scoring,
    densified,
    described,
    gradients_of,
    moved_by_adam,
    squares_of,
    trained,
)
from raster_scenes import SCENES, build_few, build_scene
from room import candidates, scene

from fvs_engine.splat.raster import Rasterizer, SquaringRasterizer, create_rasterizer
from fvs_engine.splat.raster.reference import ReferenceRasterizer
from fvs_engine.splat.views import TrainingView


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--dry-run", action="store_true")
    parser.add_argument("--model", type=Path)
    parser.add_argument("--images", type=Path)
    arguments = parser.parse_args()
    extent = DRY if arguments.dry_run else FULL
    if not arguments.dry_run and not (arguments.model and arguments.images):
        parser.error("give --model and --images, or --dry-run")
    cpu = create_rasterizer("cpu")
    tensors: dict[str, Tensor] = {}
    facts: dict[str, Any] = {}
    for name in extent.scenes or SCENES:
        tensors |= _hard_scene(name, cpu, extent, facts)
    for size in extent.scored:
        found = Scoring(cpu, extent, size).scores()
        tensors["scores.{}x{}".format(*size)] = torch.tensor(found, dtype=torch.float64)
    tensors |= {f"adam.{name}": tensor for name, tensor in moved_by_adam(cpu, extent).items()}
    tensors |= {f"densified.{name}": tensor for name, tensor in densified(cpu, extent).items()}
    tensors |= _photographs(extent, cpu, arguments.model, arguments.images, facts)
    save_file(tensors, extent.goldens, {"facts": json.dumps(facts)})
    training = trained(cpu, extent)
    facts |= {"psnr_db": training.psnr_db, "gaussians": len(training.gaussians)}
    save_file(tensors, extent.goldens, {"facts": json.dumps(facts)})
    size_mb = extent.goldens.stat().st_size / 1e6
    print(f"{extent.goldens}: {size_mb:.1f} MB, {facts['psnr_db']:.2f} dB, {facts['gaussians']:,} Gaussians")


def _hard_scene(name: str, cpu: Rasterizer, extent: Extent, facts: dict[str, Any]) -> dict[str, Tensor]:
    """The tensors of a scene, and what is to be seen of it and derived from that."""
    hard = build_few(name)[0] if extent is DRY else build_scene(name)
    facts["hard"] = described(hard.camera, hard.camera_from_model)
    rendering, gradients = gradients_of(ReferenceRasterizer(), hard.copy(torch.float64), hard)
    assert isinstance(cpu, SquaringRasterizer)
    parts = hard.gaussians.tensors() | {f"gradient.{key}": value for key, value in gradients.items()}
    parts |= {f"square.{key}": value for key, value in squares_of(cpu, hard.gaussians, hard).items()}
    parts |= {"color": rendering.color, "alpha": rendering.alpha, "depth": rendering.depth}
    parts |= {"seen": rendering.radii_px > 0, "decided": hard.decided}
    plain = {key: value.detach() for key, value in parts.items()}
    return {
        f"scene.{name}.{key}": (value.float() if value.is_floating_point() else value).contiguous()
        for key, value in plain.items()
    }


def _photographs(
    extent: Extent, cpu: Rasterizer, model: Path, images: Path, facts: dict[str, Any]
) -> dict[str, Tensor]:
    """The photographs as JPEG, their cameras, and some of the points."""
    if extent is DRY:
        views, points, colors = _room(extent, cpu)
    else:
        from scenes import load_scene

        loaded = load_scene(model, images, extent.long_side_px, limit=extent.views)
        views, points, colors = list(loaded.views), loaded.points, loaded.point_colors
    chosen = np.random.default_rng(0).permutation(len(points))[: extent.points]
    facts["views"] = [{"name": view.name, **described(view.camera, view.camera_from_model)} for view in views]
    tensors = {
        "points": torch.from_numpy(points[chosen].astype(np.float32)),
        "point_colors": torch.from_numpy(colors[chosen]),
    }
    for view in views:
        file = io.BytesIO()
        Image.fromarray(view.image).save(file, "JPEG", quality=92)
        tensors[f"photograph.{view.name}"] = torch.from_numpy(np.frombuffer(file.getvalue(), np.uint8).copy())
    return tensors


def _room(extent: Extent, cpu: Rasterizer) -> tuple[list[TrainingView], np.ndarray, np.ndarray]:
    """Renderings of a room, and points in it."""
    gaussians = scene(200)
    views = []
    for view in candidates(extent.views, extent.long_side_px, 3 * extent.long_side_px // 4):
        color = cpu.render(gaussians, view.camera, view.camera_from_model).color
        image = (255 * color.clamp(0, 1)).round().to(torch.uint8).numpy()
        views.append(TrainingView(view.name, view.camera, view.camera_from_model, image))
    return views, gaussians.means.numpy(), np.full((200, 3), 128, np.uint8)


if __name__ == "__main__":
    main()
