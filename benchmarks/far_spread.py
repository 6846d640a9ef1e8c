"""Structure from motion of far-spread subsets, from scratch and grown: what is registered, and how rightly.

    python benchmarks/far_spread.py DATA [--scenes fox bonsai castle-P19 truck11] [--subsets 10] [--images 15]
        [--seed 0] [--json far_spread.json]

Each subset: of a random three quarters of a scene's images a random one, and then always the one farthest
from all before; of small scenes four fifths of that part. From scratch: all together. Grown: the first half
together, the others one by one; once more with noisy pose priors, 2 % of the spread and 5°, where the true
orientations are known. Centres are compared with the true ones, in shares of the spread; *wrong*: more than
3 % off after a robust alignment. *truck11* has no true poses: only the verdict is reported.
"""

import argparse
import random
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gate_models import Centres, Scene
from measurement import report

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import read_dataset
from fvs_engine.scene.pose_source import dataset_priors
from fvs_engine.scene.settings import PriorNoise
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.pose_priors import ImageSet, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import Finding, Severity

SCENES = ("fox", "bonsai", "castle-P19", "truck11")
SETTINGS = SfmSettings(threads=1)
WRONG_SHARE = 0.03

Outcome = tuple[Centres, str]
"""The centres of the registered images, and the verdict."""


def read_scene(data: Path, name: str) -> Scene:
    """A scene with its true centres; those of truck11, which are unknown, are NaN."""
    if name != "truck11":
        return Scene.read(data, name)
    image_dir = data / name / "images"
    return Scene(name, image_dir, {path.name: np.full(3, np.nan) for path in image_dir.iterdir()})


def priors_of(data: Path, scene: Scene, seed: int) -> PosePriors | None:
    """Noisy pose priors of a scene whose true poses are known."""
    if scene.name == "fox":
        dataset = read_dataset(scene.image_dir, transforms=data / "fox/transforms.json")
    elif scene.name == "bonsai":
        dataset = read_dataset(scene.image_dir, colmap=data / "bonsai/reference")
    else:
        return None
    return dataset_priors(dataset, PriorNoise(), seed)


def subset(scene: Scene, count: int, draw: random.Random) -> list[str]:
    """Far-spread images of a random part of the scene; any, where it is not known which are."""
    if np.isnan(next(iter(scene.centres.values()))).any():
        pool = sorted(draw.sample(sorted(scene.centres), round(0.75 * len(scene.centres))))
        return draw.sample(pool, min(count, len(pool)))
    return scene.far_spread(count, draw)


def from_scratch(scene: Scene, names: Sequence[str], folder: Path) -> Outcome:
    """All images together."""
    result = reconstruct(ImageSet(scene.image_dir, names, PosePriors()), folder, SETTINGS, Monitor())
    return result.reconstruction.centres(), result.report.verdict


def grown(scene: Scene, names: Sequence[str], folder: Path, priors: PosePriors) -> Outcome:
    """The first half together, the others one by one."""
    growing = GrowingReconstruction.open(folder, scene.image_dir, SETTINGS, Monitor())
    half, warnings = max(2, len(names) // 2), list[Finding]()
    for some in (names[:half], *([name] for name in names[half:])):
        try:
            warnings += growing.add(some, Monitor(), priors).warnings
        except ReconstructionError:
            continue  # they support no model yet
    verdict = "doubtful" if any(warning.severity is Severity.DOUBT for warning in warnings) else "accepted"
    return growing.reconstruction.centres(), verdict if growing.registered else "rejected"


def errors(found: Centres, truth: Centres) -> np.ndarray:
    """The errors of the centres in shares of their spread; infinite when no three of them agree."""
    names = sorted(found)
    if len(names) < 3 or np.isnan(truth[names[0]]).any():
        return np.full(len(names), np.nan)
    ours, theirs = (np.stack([centres[name] for name in names]) for centres in (found, truth))
    try:
        moved = robust_umeyama(ours, theirs).transform.apply(ours)
    except InvalidInputError:
        return np.full(len(names), np.inf)
    return np.asarray(np.linalg.norm(moved - theirs, axis=1) / centre_spread(theirs))


def rows(data: Path, scene: Scene, numbers: range, count: int, seed: int) -> Iterator[dict[str, Any]]:
    """A row for each subset and way."""
    noisy = priors_of(data, scene, seed)
    for number in numbers:
        names = subset(scene, count, random.Random(f"{seed} {number}"))
        ways: dict[str, Callable[[Path], Outcome]] = {
            "from scratch": lambda folder, names=names: from_scratch(scene, names, folder),
            "grown": lambda folder, names=names: grown(scene, names, folder, PosePriors()),
        }
        if noisy is not None:
            ways["grown, priors"] = lambda folder, names=names: grown(scene, names, folder, noisy)
        for way, run in ways.items():
            began = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                try:
                    found, verdict = run(Path(folder))
                except ReconstructionError:
                    found, verdict = {}, "rejected"
            off = errors(found, scene.centres)
            yield {
                "scene": scene.name,
                "subset": number,
                "way": way,
                "images": len(names),
                "registered": len(found),
                "wrong": int((off > WRONG_SHARE).sum()),
                "median, %": 100 * float(np.median(off)) if len(off) else np.nan,
                "maximum, %": 100 * float(off.max()) if len(off) else np.nan,
                "verdict": verdict,
                "s": time.perf_counter() - began,
            }


def summary(found: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per scene and way."""
    table = []
    for scene, way in dict.fromkeys((row["scene"], row["way"]) for row in found):
        some = [row for row in found if (row["scene"], row["way"]) == (scene, way)]
        verdicts = [row["verdict"] for row in some]
        bad = [row for row in some if row["wrong"] and row["verdict"] == "accepted"]
        known = [row for row in some if np.isfinite(row["median, %"])]
        table.append(
            {
                "scene": scene,
                "way": way,
                "images": sum(row["images"] for row in some),
                "registered": sum(row["registered"] for row in some),
                "wrong": sum(row["wrong"] for row in some),
                "median of medians, %": float(np.median([row["median, %"] for row in known] or [np.nan])),
                "largest, %": max((row["maximum, %"] for row in known), default=np.nan),
                "accepted, doubtful, rejected": "/".join(
                    str(verdicts.count(verdict)) for verdict in ("accepted", "doubtful", "rejected")
                ),
                "wrong and accepted": len(bad),
            }
        )
    return table


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    parser.add_argument("--subsets", type=int, default=10)
    parser.add_argument("--images", type=int, default=15, help="of each subset, at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = []
    for name in options.scenes:
        scene = read_scene(options.data, name)
        for row in rows(options.data, scene, range(options.subsets), options.images, options.seed):
            print(row, flush=True)
            found.append(row)
    report("Subsets", found, options.json)
    report("Far-spread subsets", summary(found))


if __name__ == "__main__":
    main()
