r"""What the removal of floaters costs or gains on views that were not trained on.

    python benchmarks/floaters.py out/kermit out/fox [--picture floaters.jpg --at 3 --move 0.2 -0.08 -0.25]

Each folder is of `fvs reconstruct --quality fine`, whose checkpoint keeps the floaters. `--picture` draws the
last folder's model before and after: from the pose of its training view number `--at`, moved to the right,
down and forward by shares of the median depth of the sparse points.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from fvs_engine.geometry import RigidTransform
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.export_source import opened
from fvs_engine.pipeline.model import FolderModel, open_model
from fvs_engine.scene.photographs import Photographs
from fvs_engine.scene.quality import measure
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import to_pixels
from fvs_engine.splat.trainer import read_gaussians


def main() -> None:
    """Print a row per folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--at", type=int, default=0)
    parser.add_argument("--move", type=float, nargs=3, default=[0.0, 0.0, 0.0])
    options = parser.parse_args()
    rasterizer = create_rasterizer("cpu")
    print("| scene | views | Gaussians | floaters | PSNR before | after | SSIM before | after | seconds |")
    for folder in options.folders:
        model = open_model(folder)
        size = model.manifest.settings.training_long_side_px
        photographs = Photographs(model.workspace.undistorted_images, size)
        unseen = photographs.load_all(model.held_out, Monitor())
        kept, _, _ = read_gaussians(model.workspace.checkpoint)
        before = replace(model, gaussians=kept)
        began = time.process_time()
        with opened(folder) as source:
            cleaned = replace(source, gaussians=kept).without_floaters(Monitor())
        seconds = time.process_time() - began
        after = replace(model, gaussians=cleaned.gaussians)
        qualities = [measure(each, unseen, rasterizer, Monitor()) for each in (before, after)]
        (old, new) = (quality for quality in qualities if quality is not None)
        floaters = len(kept) - len(cleaned.gaussians)
        print(
            f"| {folder.name} | {len(model.views)} | {len(kept):,} | {floaters} | {old.psnr_db:.2f} dB "
            f"| {new.psnr_db:.2f} ({new.psnr_db - old.psnr_db:+.3f}) | {old.ssim:.4f} | {new.ssim:.4f} "
            f"| {seconds:.1f} |",
            flush=True,
        )
    if options.picture is not None:
        depths = model.views[options.at].camera_from_model.apply(cleaned.points.xyz)[:, 2]
        offset = float(np.median(depths)) * np.array(options.move)
        _draw(model, (before, after), options.at, offset, options.picture)


def _draw(
    model: FolderModel, models: Sequence[SceneModel], at: int, offset: np.ndarray, picture: Path
) -> None:
    view = model.views[at]
    pose = view.camera_from_model
    moved = replace(view, camera_from_model=RigidTransform(pose.rotation, pose.translation - offset))
    rasterizer = create_rasterizer("cpu")
    renders = [to_pixels(each.render(moved, rasterizer)) for each in models]
    Image.fromarray(np.concatenate(renders, axis=1)).save(picture, quality=85)


if __name__ == "__main__":
    main()
