"""Views far from one another, of a scene with repeating wallpaper, are added to ten that lie side by side."""

from pathlib import Path

import numpy as np
import pytest

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, read_dataset
from fvs_engine.scene.dataset_priors import dataset_priors
from fvs_engine.scene.settings import PriorNoise
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.settings import SfmSettings

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

FIRST, FAR = 10, 10
MAX_SHARE = 0.03
"""Of the spread: images that wallpaper misled were off by 200 %."""


def farthest(dataset: Dataset) -> list[str]:
    """The first views of the capture, and then always the one farthest from all before."""
    pool, _ = hold_out(dataset.names, 8)
    centres = dataset.centres()
    names = list(pool[:FIRST])
    while len(names) < FIRST + FAR:
        others = [name for name in pool if name not in names]
        gaps = [min(np.linalg.norm(centres[name] - centres[other]) for other in names) for name in others]
        names.append(others[int(np.argmax(gaps))])
    return names


def test_noisy_priors_place_far_views_of_fox(data_dir: Path, tmp_path: Path):
    dataset = read_dataset(data_dir / "fox/images", transforms=data_dir / "fox/transforms.json")
    priors = dataset_priors(dataset, PriorNoise(), seed=0)
    growing = GrowingReconstruction.open(
        tmp_path / "grown", dataset.image_dir, SfmSettings(threads=1), Monitor()
    )
    names = farthest(dataset)
    growing.add(names[:FIRST], Monitor(), priors)
    for name in names[FIRST:]:
        growing.add([name], Monitor(), priors)
    found, truth = growing.reconstruction.centres(), dataset.centres()
    assert len(found) >= FIRST + FAR - 1
    ours, theirs = (np.stack([centres[name] for name in sorted(found)]) for centres in (found, truth))
    off = np.linalg.norm(robust_umeyama(ours, theirs).transform.apply(ours) - theirs, axis=1)
    assert off.max() < MAX_SHARE * centre_spread(np.stack(list(truth.values())))
