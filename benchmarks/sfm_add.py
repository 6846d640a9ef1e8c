"""Time of adding image n + 1 to a reconstruction, compared with a new reconstruction of all images.

    python benchmarks/sfm_add.py IMAGES [--transforms FILE | --colmap DIR] [--counts 10 25 49] [--json FILE]

The first ten images (sorted names are the capture order) are reconstructed together, the others added one by
one. Around every count the time of adding is taken over several images; then all n + 1 images are
reconstructed from scratch (goals: at 50 adding costs ≤ 1/10 of that, and the added camera is ≤ 1.2 times as
far from the truth). Errors are distances of camera centres after Umeyama over all n + 1 centres, in shares of
the spread of the true ones. Processor time is that of all processes, and independent of other load.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from measurement import Timing, report
from numpy.typing import NDArray
from processor_time import so_far_s

from fvs_engine.geometry import umeyama
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.colmap.imports import import_colmap
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.wording import text

BOOTSTRAP = 10
TIMED = 5
"""Images whose adding is timed around a count: two before, the one, two after."""

Centres = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Added:
    """One image added: the time it took, and all camera centres after it."""

    name: str
    seconds: float
    processor_s: float
    centres: Centres


def truth_of(options: argparse.Namespace) -> Centres:
    if options.transforms is not None:
        return by_file_name(import_transforms_json(options.transforms).centres())
    if options.colmap is not None:
        return by_file_name(import_colmap(options.colmap).centres())
    return {}


def by_file_name(centres: Centres) -> Centres:
    return {Path(name).name: centre for name, centre in centres.items()}


def errors(centres: Centres, truth: Centres) -> dict[str, float]:
    """Name → distance from the truth after Umeyama, in shares of the spread of the true centres."""
    names = sorted(centres.keys() & truth.keys())
    if len(names) < 4:
        return {}
    source = np.stack([centres[name] for name in names])
    target = np.stack([truth[name] for name in names])
    spread = np.sqrt(((target - target.mean(axis=0)) ** 2).sum(axis=1).mean())
    distances = np.linalg.norm(umeyama(source, target).apply(source) - target, axis=1) / spread
    return dict(zip(names, distances.tolist(), strict=True))


def grow(images: Path, names: list[str], folder: Path, settings: SfmSettings) -> Iterator[Added]:
    """Reconstruct the first ten, add the others one by one; registered ones are skipped."""
    growing = GrowingReconstruction.open(folder, images, settings, Monitor())
    growing.add(names[:BOOTSTRAP], Monitor())
    for name in names[BOOTSTRAP:]:
        if name in growing.registered:
            continue
        begun, worked = time.perf_counter(), so_far_s()
        update = growing.add([name], Monitor())
        seconds, worked = time.perf_counter() - begun, so_far_s() - worked
        print(
            f"{name}: {seconds:.1f} s, processor {worked:.1f} s, {len(growing.registered)} registered, "
            f"{update.seconds}",
            flush=True,
        )
        for warning in update.warnings:
            print(f"  {text(warning)}", flush=True)
        yield Added(name, seconds, worked, growing.reconstruction.centres())


def compare(
    images: Path, names: list[str], around: list[Added], one: Added, truth: Centres, settings: SfmSettings
) -> dict[str, Any]:
    """A row of the table: the last of ``names`` added, and all of them from scratch."""
    seconds = [added.seconds for added in around]
    adding = Timing(min(seconds), median(seconds), max(seconds), len(seconds))
    processor = median(added.processor_s for added in around)
    with tempfile.TemporaryDirectory() as folder:
        begun, worked = time.perf_counter(), so_far_s()
        scratch = reconstruct(ImageSet(images, names), Path(folder), settings, Monitor())
        from_nothing, worked = time.perf_counter() - begun, so_far_s() - worked
    print(f"{len(names)} from scratch: {from_nothing:.1f} s, {scratch.report.seconds}", flush=True)
    ours, theirs = errors(one.centres, truth), errors(scratch.reconstruction.centres(), truth)
    apart = errors(one.centres, scratch.reconstruction.centres())
    row: dict[str, Any] = {
        "n": len(names) - 1,
        "adding one": adding,
        "from scratch, s": from_nothing,
        "× faster": from_nothing / adding.median_s,
        "processor: adding, s": processor,
        "processor: from scratch, s": worked,
        "× less": worked / processor,
        "registered": f"{len(one.centres)} / {len(scratch.reconstruction.views)}",
        "apart, %": 100 * apart.get(one.name, float("nan")),
    }
    if truth:
        mine, other = ours.get(one.name, float("nan")), theirs.get(one.name, float("nan"))
        row |= {
            "error added, %": 100 * mine,
            "from scratch, %": 100 * other,
            "ratio": mine / other,
            "median of all, %": 100 * median(ours.values()),
            "from scratch, all, %": 100 * median(theirs.values()),
            "ratio, all": median(ours.values()) / median(theirs.values()),
        }
    return row


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("images", type=Path, help="folder of photographs")
    given = parser.add_mutually_exclusive_group()
    given.add_argument("--transforms", type=Path, help="transforms.json with true poses")
    given.add_argument("--colmap", type=Path, help="COLMAP model with true poses")
    parser.add_argument("--counts", type=int, nargs="+", default=[10, 25, 50])
    parser.add_argument("--keep", type=Path, help="folder of the growing reconstruction, resumed")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    everything = sorted(path.name for path in options.images.iterdir() if path.is_file())
    counts = [count for count in options.counts if BOOTSTRAP <= count < len(everything)]
    names = everything[: max(counts) + 1 + TIMED // 2]
    settings = SfmSettings()
    truth = truth_of(options)
    with tempfile.TemporaryDirectory() as scratch:
        rows = []
        added: list[Added] = []
        for step in grow(options.images, names, options.keep or Path(scratch) / "growing", settings):
            added.append(step)
            position = names.index(step.name)
            for count in counts:
                if position == min(count + TIMED // 2, len(names) - 1):
                    around = [one for one in added if abs(names.index(one.name) - count) <= TIMED // 2]
                    one = next(one for one in around if one.name == names[count])
                    rows.append(compare(options.images, names[: count + 1], around, one, truth, settings))
    report(f"sfm-add, {options.images}", rows, options.json)


if __name__ == "__main__":
    main()
