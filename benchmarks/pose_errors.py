"""Pose errors of the runs of `fvs evaluate --poses sfm`, against the poses of the dataset.

    python benchmarks/pose_errors.py DATASET OUT [--colmap MODEL] [--json pose_errors.json]

OUT is the folder of a comparison. Per run: visited and registered views, and the distances of the camera
centres of its last model from the dataset's, in shares of the spread of all its cameras, after a robust
alignment; *wrong*: more than 3 % off. Methods never see the dataset's poses without noise.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from measurement import report

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.lab.evaluate.results import Run, read_result
from fvs_engine.scene.dataset import Dataset, open_dataset
from fvs_engine.sfm.colmap.model import open_colmap

WRONG_SHARE = 0.03


def row(dataset: Dataset, run: Run, model_dir: Path) -> dict[str, Any]:
    """One run and the errors of its model."""
    centres, last = dataset.centres(), run.evaluations[-1]
    spread = centre_spread(np.stack(list(centres.values())))
    images = [image for image in open_colmap(model_dir).images.values() if image.has_pose]
    ours = np.stack([image.projection_center() for image in images])
    theirs = np.stack([centres[image.name] for image in images])
    moved = robust_umeyama(ours, theirs).transform.apply(ours)
    off = np.linalg.norm(moved - theirs, axis=1) / spread
    return {
        "selector": run.method,
        "seed": run.seed,
        "views": last.visited,
        "registered": len(images),
        "wrong": int((off > WRONG_SHARE).sum()),
        "median, %": 100 * float(np.median(off)),
        "maximum, %": 100 * float(off.max()),
        "held-out, dB": last.psnr_db,
        "unvisited, dB": last.unvisited_db,
        "travel": last.travel,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="photographs with poses, as for `fvs evaluate`")
    parser.add_argument("out", type=Path)
    parser.add_argument("--colmap", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    dataset = open_dataset(options.dataset, options.colmap)
    rows = []
    for path in sorted(options.out.glob("runs/*/run.json")):
        run = read_result(path, Run)
        assert run is not None
        rows.append(row(dataset, run, max(path.parent.glob("selection/**/model-*"))))
    report(f"poses estimated, {dataset.name}", rows, options.json)


if __name__ == "__main__":
    main()
