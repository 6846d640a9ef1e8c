"""What a GPU is held to, computed on the CPU.

    python benchmarks/gpu/goldens.py --model MODEL --images IMAGES

MODEL is a folder with a COLMAP model, IMAGES its photographs. Writes ``goldens.safetensors`` beside this
file, at most 5 MB: scenes that break rasterisers, with the images and gradients of the reference in float64;
the scores of 300 candidates at two sizes; a training of 500 steps, with its photographs; a step of Adam; a
densification.
"""

import argparse
import io
import json
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from safetensors.torch import save_file
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "fixtures"))
sys.path.insert(0, str(Path(__file__).parents[1]))

from proof import (
    FILE,
    SCORED,
    Goldens,
    candidate_scores,
    densified,
    described,
    gradients_of,
    moved_by_adam,
    trained,
)
from raster_scenes import SCENES, build_scene
from scenes import Scene, load_scene

from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.raster.reference import ReferenceRasterizer

LONG_SIDE_PX, VIEWS, POINTS = 320, 33, 8_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--images", type=Path, required=True)
    arguments = parser.parse_args()
    tensors: dict[str, Tensor] = {}
    facts: dict[str, object] = {}
    for name in SCENES:
        scene = build_scene(name)
        facts["hard"] = described(scene.camera, scene.camera_from_model)
        rendering, gradients = gradients_of(ReferenceRasterizer(), scene.copy(torch.float64), scene)
        parts = scene.gaussians.tensors() | {f"gradient.{key}": value for key, value in gradients.items()}
        parts |= {"color": rendering.color, "alpha": rendering.alpha, "depth": rendering.depth}
        parts |= {"seen": rendering.radii_px > 0, "decided": scene.decided}
        for key, value in parts.items():
            value = value.detach()
            tensors[f"scene.{name}.{key}"] = value.float() if value.is_floating_point() else value
    cpu = create_rasterizer("cpu")
    for size in SCORED:
        tensors["scores.{}x{}".format(*size)] = torch.tensor(candidate_scores(cpu, size), dtype=torch.float64)
    tensors |= {f"adam.{name}": tensor for name, tensor in moved_by_adam(cpu).items()}
    tensors |= {f"densified.{name}": tensor for name, tensor in densified(cpu).items()}
    tensors |= _photographs(load_scene(arguments.model, arguments.images, LONG_SIDE_PX, limit=VIEWS), facts)
    save_file(tensors, FILE, {"facts": json.dumps(facts)})
    facts["psnr_db"] = trained(cpu, Goldens.read()).psnr_db
    save_file(tensors, FILE, {"facts": json.dumps(facts)})
    print(f"{FILE}: {FILE.stat().st_size / 1e6:.1f} MB, {facts['psnr_db']:.2f} dB")


def _photographs(scene: Scene, facts: dict[str, object]) -> dict[str, Tensor]:
    """The photographs as JPEG, their cameras, and some of the points."""
    chosen = np.random.default_rng(0).permutation(len(scene.points))[:POINTS]
    facts["views"] = [
        {"name": view.name, **described(view.camera, view.camera_from_model)} for view in scene.views
    ]
    tensors = {
        "points": torch.from_numpy(scene.points[chosen].astype(np.float32)),
        "point_colors": torch.from_numpy(scene.point_colors[chosen]),
    }
    for view in scene.views:
        file = io.BytesIO()
        Image.fromarray(view.image).save(file, "JPEG", quality=92)
        tensors[f"photograph.{view.name}"] = torch.from_numpy(np.frombuffer(file.getvalue(), np.uint8).copy())
    return tensors


if __name__ == "__main__":
    main()
