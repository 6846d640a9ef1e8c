"""The paper's experiment with estimated poses and noisy pose priors, starting from ten photographs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from far_views import bonsai, fox, shares_off

from fvs_engine.lab.evaluate.results import Run, read_result
from fvs_engine.scene.dataset import Dataset
from fvs_engine.sfm.colmap.model import open_colmap

pytestmark = [pytest.mark.slow, pytest.mark.timeout(5400)]

MAX_SHARE = 0.03
"""Of the spread of all cameras. The dataset's poses are not given to the method without noise."""


@pytest.mark.parametrize(
    ("scene", "method", "views", "fewest"),
    [
        (fox, "median-frequency", 20, 19),
        (fox, "farthest", 20, 19),
        (bonsai, "median-frequency", 40, 38),
        (bonsai, "farthest", 40, 34),
    ],
)
def test_chosen_views_are_registered_where_they_are(
    scene: Callable[[Path], Dataset],
    method: str,
    views: int,
    fewest: int,
    fvs: Callable[..., Any],
    data_dir: Path,
    tmp_path: Path,
) -> None:
    dataset = scene(data_dir)
    colmap = ("--colmap", data_dir / "bonsai/reference") if scene is bonsai else ()
    done = fvs(
        *("evaluate", dataset.image_dir.parent, *colmap, "--out", tmp_path, "--preset", "paper"),
        *("--methods", method, "--views", f"10,{views}", "--seeds", 0, "--threads", 1),
        *("--long-side", 256, "--max-gaussians", 25_000),
    )
    assert done.status == 0, done.stderr
    (path,) = tmp_path.glob("runs/*/run.json")
    run = read_result(path, Run)
    assert run is not None
    assert run.evaluations[-1].visited == views
    model = open_colmap(max(path.parent.glob("selection/**/model-*")))
    off = shares_off(
        {image.name: image.projection_center() for image in model.images.values() if image.has_pose}, dataset
    )
    assert len(off) >= fewest
    assert max(off.values()) < MAX_SHARE
